// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "imu/propagation.hpp"

namespace apvi::vio {

/// State estimate of another estimator (DIPO), used for initialization and while the window is
/// frozen.
struct StatePrior {
  imu::NavState state = {};
  imu::NavMatrix covariance = imu::NavMatrix::Identity();  ///< order of imu::NavIndex
};

/// The rotation about the vertical and translation that align `there` with `here`; roll and pitch
/// are ignored.
SE3 level_alignment(const SE3& here, const SE3& there);
/// The state in another world frame; velocity and biases are in the body frame and do not change.
imu::NavState transformed(const SE3& T, imu::NavState state);
StatePrior transformed(const SE3& T, const StatePrior& prior);

}  // namespace apvi::vio
