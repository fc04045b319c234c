// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/render/ray_caster.hpp"
#include "sim/spectral/sea_state.hpp"

namespace apvi::sim {

/// Distances from a lamp to the scene over the hemisphere in front of it, for shadows (a shadow map
/// in paraboloid coordinates).
class LampShadow {
 public:
  LampShadow(const LampPose& lamp, const RayCaster& world);

  /// Lit fraction of a point, 0 to 1: four neighboring rays, weighted. 1 behind the lamp.
  float lit(const Eigen::Vector3f& p) const;

 private:
  static constexpr int kSize = 256;

  LampPose lamp_;
  Eigen::Vector3f right_, down_;
  std::vector<float> range_;  ///< kSize^2, rows along `down`
};

}  // namespace apvi::sim
