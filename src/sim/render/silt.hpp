// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "sim/render/shading.hpp"

namespace apvi::sim {

/// A cloud of stirred-up silt that drifts with the water.
struct SiltCloud {
  double density = 0.0;  ///< 0: none; 1: hides nearly everything
  double time_s = 0.0;
  Eigen::Vector3f color = Eigen::Vector3f::Zero();  ///< light scattered back by a dense cloud
};

/// Adds the cloud in front of the camera, from noise sampled at a few distances.
void add_silt(const SiltCloud& cloud, TileRays& tile);

}  // namespace apvi::sim
