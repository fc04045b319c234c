// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi {

/// Which way the world's axes point. `up`: z up (x, y level). `ned`: x north, y east, z down, and
/// the body is forward, right, down by custom.
enum class WorldFrame { up, ned };

struct ImuCalibration {
  double rate_hz = 100.0;
  double gyro_noise_density = 1e-3;   ///< [rad/s/sqrt(Hz)]
  double gyro_random_walk = 1e-5;     ///< [rad/s²/sqrt(Hz)]
  double accel_noise_density = 1e-2;  ///< [m/s²/sqrt(Hz)]
  double accel_random_walk = 1e-4;    ///< [m/s³/sqrt(Hz)]
};

struct CameraCalibration {
  CameraModel model;
  SE3 T_body_camera;
  double rate_hz = 20.0;
  double time_offset_s = 0.0;  ///< true time = stamp - offset
};

struct DvlCalibration {
  SE3 T_body_dvl;
  double time_offset_s = 0.0;    ///< by how much the stamps are late: true time = stamp - offset
  double velocity_noise = 0.01;  ///< of each component or beam, one sigma [m/s]
  /// Unit vectors in the sensor frame; a beam reads its dot product with the sensor's velocity.
  std::array<Eigen::Vector3d, kDvlBeams> beams;
  double scale = 1.0;  ///< true velocity / reported velocity = sound speed / assumed sound speed
  /// Signs of the reported components, for devices or logs whose axes are left-handed.
  Eigen::Vector3d axis_signs = Eigen::Vector3d::Ones();

  /// The sensor's velocity in its own right-handed frame [m/s] from what was reported.
  Eigen::Vector3d true_velocity(const Eigen::Vector3d& reported) const {
    return scale * axis_signs.cwiseProduct(reported);
  }
};

struct PressureCalibration {
  Eigen::Vector3d p_body_sensor = Eigen::Vector3d::Zero();  ///< [m]
  double water_density = 1025.0;                            ///< [kg/m³]
  double gravity = 9.80665;                                 ///< [m/s²]
  double atmospheric_pressure_pa = 101325.0;                ///< [Pa]
  double noise_m = 0.01;                                    ///< one sigma, as depth [m]

  /// Depth of the sensor below the surface [m].
  double depth(double pressure_pa) const {
    return (pressure_pa - atmospheric_pressure_pa) / (water_density * gravity);
  }
};

struct DepthCalibration {
  Eigen::Vector3d p_body_sensor = Eigen::Vector3d::Zero();  ///< [m]
  double noise_m = 0.01;                                    ///< one sigma [m]
};

/// A lamp on the vehicle that lights what the camera sees; it shines along its z axis.
struct LampCalibration {
  SE3 T_body_lamp;
  double half_beam_rad = 1.0;  ///< angle to the axis at which it is half as bright
};

/// Calibration of a vehicle. The body frame is the IMU's.
struct Rig {
  WorldFrame world = WorldFrame::up;
  std::optional<ImuCalibration> imu;
  std::vector<CameraCalibration> cameras;  ///< cam0, cam1
  std::optional<DvlCalibration> dvl;
  std::optional<PressureCalibration> pressure;
  std::optional<DepthCalibration> depth;
  std::optional<LampCalibration> lamp;

  /// Gravity in world coordinates [m/s²] for the given magnitude.
  Eigen::Vector3d gravity(double magnitude) const {
    return {0.0, 0.0, world == WorldFrame::ned ? magnitude : -magnitude};
  }
  /// +1 when a larger world z means deeper (ned), else -1.
  double depth_sign() const { return world == WorldFrame::ned ? 1.0 : -1.0; }
};

/// The Janus geometry of a Water Linked A50: 22.5 degrees off the vertical, at 45 degrees and so on
/// about it.
std::array<Eigen::Vector3d, kDvlBeams> default_dvl_beams();

/// Reads a rig from configuration nodes (the content of rig.yaml). Rotations are
/// re-orthonormalised. Throws InputError with file and line for unknown keys, values out of range,
/// matrices that are no rigid motion, and beams that are no unit vectors.
Rig make_rig(const config::Node& node);
/// The documentation of every key of rig.yaml as a Markdown table.
std::string rig_documentation();

}  // namespace apvi
