// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>

#include "apvi/geometry/se3.hpp"

namespace apvi::loop_closure {

/// Angle between the optical axes of two cameras [rad].
inline double angle_of_axes(const SE3& T_a_b) {
  return std::acos(std::clamp((T_a_b.rotation * Eigen::Vector3d::UnitZ()).z(), -1.0, 1.0));
}

}  // namespace apvi::loop_closure
