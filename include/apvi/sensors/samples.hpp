// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string_view>
#include <variant>

#include "apvi/core/stamp.hpp"

/// Sensor samples in SI units and in the sensors' own frames.
namespace apvi {

struct ImuSample {
  Stamp stamp;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();   ///< angular velocity [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();  ///< specific force [m/s²]
};

struct DvlBeam {
  double velocity = 0.0;        ///< along the beam [m/s], in the direction of the rig's beam vector
  std::optional<double> range;  ///< to the bottom, along the beam [m]
  bool valid = false;
};

inline constexpr std::size_t kDvlBeams = 4;

struct DvlSample {
  Stamp stamp;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< over ground, sensor frame [m/s]
  bool valid = false;                     ///< bottom lock; the velocity is undefined without it
  std::optional<double> figure_of_merit;  ///< as the device reports it [m/s]
  std::optional<double> altitude;         ///< above the bottom [m]
  std::array<std::optional<DvlBeam>, kDvlBeams> beams;
};

struct PressureSample {
  Stamp stamp;
  double pressure_pa = 0.0;  ///< absolute [Pa]
};

struct PressureDepthSample {
  Stamp stamp;
  double depth_m = 0.0;  ///< positive below the surface [m]
};

struct GnssSample {
  Stamp stamp;
  Eigen::Vector3d east_north_up = Eigen::Vector3d::Zero();  ///< [m]
};

/// A camera frame that is decoded on demand: a run without vision decodes nothing, and decoding
/// happens on the thread that needs the pixels.
struct ImageFrame {
  Stamp stamp;
  int camera = 0;
  std::function<cv::Mat()> decode;  ///< 8-bit gray or BGR; throws RunError when the file is damaged
  /// The mask of this image alone, for the map, in the form of CameraCalibration::mask. Empty:
  /// none. Throws RunError when the file is damaged.
  std::function<cv::Mat()> mask{};
};

using SensorEvent =
    std::variant<ImuSample, DvlSample, PressureSample, PressureDepthSample, ImageFrame, GnssSample>;

Stamp stamp_of(const SensorEvent& event);
/// "imu", "dvl", "pressure", "depth", "camera" or "gnss".
std::string_view kind_of(const SensorEvent& event);
/// Whether every number in the sample is finite (images: always).
bool is_finite(const SensorEvent& event);

}  // namespace apvi
