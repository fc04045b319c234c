// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi {

/// The rigid motion T minimising sum |target_i - T source_i|² (Umeyama 1991, scale fixed to one).
/// Nothing for fewer than three points, or when all points of a set lie on one point or line, where
/// the rotation is not determined.
std::optional<SE3> align_rigid(const std::vector<Eigen::Vector3d>& source,
                               const std::vector<Eigen::Vector3d>& target);

/// The same with a rotation about z only, for estimates whose vertical is known from gravity. Needs
/// two points that differ horizontally.
std::optional<SE3> align_yaw(const std::vector<Eigen::Vector3d>& source,
                             const std::vector<Eigen::Vector3d>& target);

}  // namespace apvi
