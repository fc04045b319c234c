// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "doctor/image_pairs.hpp"

namespace apvi::doctor {

/// How a camera turned between the images of a pair, by the images alone.
struct CameraRate {
  Stamp stamp;                                     ///< in the middle of the pair
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();  ///< mean, in the camera's axes [rad/s]
};

/// The rates of pairs in order of time: of each, the rotation that places its corners best on
/// epipolar lines (see CameraGyroProblem). Pairs that do not determine their rotation are left out.
std::vector<CameraRate> camera_rates(const std::vector<ImagePair>& pairs,
                                     const CameraModel& camera);

}  // namespace apvi::doctor
