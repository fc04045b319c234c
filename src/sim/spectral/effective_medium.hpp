// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/render/water.hpp"

namespace apvi::sim {

/// A surface seen through water, in the linear light of the image (red, green, blue).
struct SeenSurface {
  double range = 0.0;  ///< [m]
  Eigen::Vector3d clear = Eigen::Vector3d::Zero();
  Eigen::Vector3d direct = Eigen::Vector3d::Zero();  ///< what of it reaches the camera
};
/// The backscatter of daylight up to a range.
struct SeenBackscatter {
  double range = 0.0;  ///< [m]
  Eigen::Vector3d scattered = Eigen::Vector3d::Zero();
};

/// The coefficients of I = J exp(-beta_d r) + b_inf (1 - exp(-beta_b r)) that come nearest to
/// spectral light, which has no such coefficients: beta_d by least squares of log(direct / clear)
/// over range, beta_b and b_inf by least squares of the backscatter over range. Without a scattered
/// b_inf is 0 and beta_b is beta_d.
Medium effective_medium(const std::vector<SeenSurface>& surfaces,
                        const std::vector<SeenBackscatter>& scattered_all);

}  // namespace apvi::sim
