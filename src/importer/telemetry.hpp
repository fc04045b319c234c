// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "importer/gpmf.hpp"
#include "importer/mp4.hpp"

namespace apvi::importer {

/// Times are those of the video: 0 is where its presentation begins [s].
struct TimedVector {
  double time_s = 0.0;
  Eigen::Vector3d value;
};

struct ImuRow {
  double time_s = 0.0;
  Eigen::Vector3d gyro;   ///< [rad/s]
  Eigen::Vector3d accel;  ///< specific force [m/s²]
};

/// Exposure of one image; what the camera does not report is empty.
struct ExposureRow {
  double time_s = 0.0;
  std::optional<double> shutter_s = {};
  std::optional<double> iso = {};
  std::optional<double> white_balance_k = {};
  std::optional<Eigen::Vector3d> gains = {};  ///< red, green, blue
};

struct Telemetry {
  std::string device;       ///< "HERO10 Black"; may be empty
  std::vector<ImuRow> imu;  ///< in the axes of the camera: x right, y down, z forward
  std::vector<ExposureRow> exposure;
  /// Greatest rotation of an image against the camera's body (IORI) [rad]: that of stabilization or
  /// of a camera that hung upside down. 0 if not reported.
  double image_rotation_rad = 0.0;
};

/// A payload and when the video presents it.
struct TimedPayload {
  GpmfPayload payload;
  double time_s = 0.0;
  double duration_s = 0.0;
};

/// Rotation from a stream's channels to the camera's axes. ORIN names the channels by the axes of
/// GoPro's frame (X left, Y backward, Z up; lowercase is negative). Without it the order is that
/// which GoPro documents for the `device`: Z, X, Y of a HERO5; Y, -X, Z of a HERO6 or HERO7;
/// -Y, X, Z of a Fusion. With MTRX, ORIO names the axes of the product; ORIN decides when the two
/// contradict. nullopt when the letters name no right-handed frame.
/// Source: github.com/gopro/gpmf-parser, README, "Where to find GPMF data".
std::optional<Eigen::Matrix3d> rotation_to_camera(const GpmfStream& stream,
                                                  const std::string& device = "");

/// Times of a stream's samples [s]. By STMP where each payload has one, which the camera measured;
/// else evenly spaced over payloads that follow each other.
std::vector<double> sample_times(const std::vector<TimedPayload>& payloads, const std::string& key);

/// Joins the payloads' streams. Accelerometer samples are interpolated at the times of the gyro's,
/// which may be faster.
Telemetry join_telemetry(const std::vector<TimedPayload>& payloads);

/// Reads the `gpmd` track of an MP4 file; nullopt if it has none. Damaged payloads are skipped with
/// a warning.
std::optional<Telemetry> read_telemetry(const std::filesystem::path& path, const Mp4Movie& movie);

}  // namespace apvi::importer
