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
};

/// The pose of a body after a change of the unit. Its point `p_body` (of the body frame [m]), such
/// as the camera whose images gave the pose, moves to the changed position; the body keeps its
/// size.
inline SE3 changed(const ScaleChange& change, const SE3& T_world_body,
                   const Eigen::Vector3d& p_body) {
  const Eigen::Vector3d p = T_world_body * p_body;
  return {T_world_body.rotation, T_world_body.translation + (change * p - p)};
}

}  // namespace apvi
