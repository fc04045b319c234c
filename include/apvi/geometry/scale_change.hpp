// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/geometry/se3.hpp"

namespace apvi {

/// A change of the unit of length about a point that stays: p' = center + scale (p - center).
struct ScaleChange {
  double scale = 1.0;  ///< new units per old unit
  Eigen::Vector3d center = Eigen::Vector3d::Zero();

  friend Eigen::Vector3d operator*(const ScaleChange& c, const Eigen::Vector3d& p) {
    return c.center + c.scale * (p - c.center);
  }
  friend SE3 operator*(const ScaleChange& c, const SE3& T_world_body) {
    return {T_world_body.rotation, c * T_world_body.translation};
  }
};

}  // namespace apvi
