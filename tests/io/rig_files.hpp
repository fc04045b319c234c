// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "apvi/io/rig_file.hpp"
#include "apvi/sensors/rig.hpp"
#include "support/matchers.hpp"

/// Calibration files of other tools.
namespace apvi::test {

inline Rig rig_of(const std::filesystem::path& file) {
  return make_rig(io::load_rig_file(file));
}

/// What reading a rig logs.
inline std::string log_of(const std::filesystem::path& file) {
  testing::internal::CaptureStderr();
  rig_of(file);
  return testing::internal::GetCapturedStderr();
}

/// The text with the first occurrence of `from` replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

/// Kalibr's camchain and imu.yaml. Body forward-left-up; cam0 looks forward from (0.2, 0.1, -0.3).
/// cam1 is 0.12 m to its right, rotated by 90 degrees about the optical axis.
inline constexpr const char* kCamchain = R"(cam0:
  T_cam_imu:
  - [0.0, -1.0, 0.0, 0.1]
  - [0.0, 0.0, -1.0, -0.3]
  - [1.0, 0.0, 0.0, -0.2]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.03
cam1:
  T_cn_cnm1:
  - [0.0, 1.0, 0.0, 0.0]
  - [-1.0, 0.0, 0.0, 0.12]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.003, 0.0004]
  distortion_model: equidistant
  intrinsics: [400.0, 401.0, 376.0, 240.0]
  resolution: [752, 480]
)";
inline constexpr const char* kKalibrImu = R"(accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
gyroscope_noise_density: 1.7e-4
gyroscope_random_walk: 2.0e-5
rostopic: /imu0
update_rate: 200.0
)";

/// cam0 of the chain above.
inline void expect_forward_camera(const CameraCalibration& camera) {
  EXPECT_THAT(camera.T_body_camera.translation, MatrixNear(Eigen::Vector3d(0.2, 0.1, -0.3), 1e-12));
  // The optical axis points forward, and the image's x axis to the right.
  EXPECT_THAT(Eigen::Vector3d(camera.T_body_camera.rotation * Eigen::Vector3d::UnitZ()),
              MatrixNear(Eigen::Vector3d(1, 0, 0), 1e-12));
  EXPECT_THAT(Eigen::Vector3d(camera.T_body_camera.rotation * Eigen::Vector3d::UnitX()),
              MatrixNear(Eigen::Vector3d(0, -1, 0), 1e-12));
}

}  // namespace apvi::test
