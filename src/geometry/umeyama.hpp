// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi {

/// The rigid transform T that minimizes sum |target_i - T source_i|² (Umeyama 1991, unit scale).
/// nullopt for fewer than three points, and for coincident or collinear points, which do not
/// determine the rotation.
std::optional<SE3> align_rigid(const std::vector<Eigen::Vector3d>& source,
                               const std::vector<Eigen::Vector3d>& target);

/// The scale of the similarity transform that minimizes sum |target_i - (s R source_i + t)|²
/// (Umeyama 1991); nullopt for fewer than three points and for coincident or collinear ones.
std::optional<double> similarity_scale(const std::vector<Eigen::Vector3d>& source,
                                       const std::vector<Eigen::Vector3d>& target);

/// As `align_rigid`, but with a rotation about z only, for estimates whose vertical is known from
/// gravity. Requires two horizontally distinct points.
std::optional<SE3> align_yaw(const std::vector<Eigen::Vector3d>& source,
                             const std::vector<Eigen::Vector3d>& target);

}  // namespace apvi
