// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "doctor/camera_gyro_problem.hpp"
#include "doctor/dvl_imu_fit.hpp"

namespace apvi::doctor {

/// Mirrored images. A mirrored view of a rotation is again a rotation, that of a camera turned by
/// 180 degrees about the mirrored axis. Only the direction of motion tells them apart.
struct Mirror {
  const char* name = "";  ///< "left to right" or "top to bottom"
  Eigen::Quaterniond R_camera_body = Eigen::Quaterniond::Identity();  ///< with flipped images
  std::size_t pairs = 0;  ///< that the DVL's velocity decided; 0: no DVL, by nearness to the rig
};

/// Compares the direction in which the images show the camera to move with the DVL's velocity.
/// Without a DVL, a rotation near 180 degrees about a mirrored axis is taken for a mirror.
std::optional<Mirror> find_mirror(const std::vector<DvlPing>& pings, const DvlMounting& mounting,
                                  const CameraGyroProblem& problem, const CameraGyroModel& model,
                                  const CameraGyroModel& rig, double noise_px);

/// Largest shift of an image corner by a change of the first distortion coefficient [px], beyond
/// the best change of the focal length.
double lens_shift_px(const CameraModel& camera, double radial);

}  // namespace apvi::doctor
