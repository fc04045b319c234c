// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/imu/propagation.hpp"

namespace apvi::vio {

/// The state as another estimator knows it (DIPO): what a start and a frozen window lean on.
struct Aid {
  imu::NavState state = {};
  imu::NavMatrix covariance = imu::NavMatrix::Identity();  ///< order of imu::NavIndex
};

/// A turn about the vertical and a shift that bring `there` onto `here`, tilt left out.
SE3 level_alignment(const SE3& here, const SE3& there);
/// The same in another world; velocity and biases are the body's and stay.
imu::NavState moved(const SE3& T, imu::NavState state);
Aid moved(const SE3& T, const Aid& aid);

}  // namespace apvi::vio
