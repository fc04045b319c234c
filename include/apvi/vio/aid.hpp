// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/imu/propagation.hpp"

namespace apvi::vio {

/// The state as another estimator knows it (DIPO): what a start and a frozen window lean on.
struct Aid {
  imu::NavState state = {};
  imu::NavMatrix covariance = imu::NavMatrix::Identity();  ///< order of imu::NavIndex
};

}  // namespace apvi::vio
