// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"

namespace apvi {

struct StampedPose {
  Stamp stamp;
  SE3 T_world_body;
};

/// Poses in chronological order. A position-only reference (GNSS) has `has_rotation` false and
/// identity rotations; a planar one has `has_height` false and undefined z.
struct Trajectory {
  std::vector<StampedPose> poses;
  bool has_rotation = true;
  bool has_height = true;

  bool empty() const { return poses.empty(); }
  std::size_t size() const { return poses.size(); }
  /// Length of the polyline through the positions [m].
  double path_length() const;
  /// Adds poses, in any place; they replace those of equal stamps.
  void merge(const std::vector<StampedPose>& added);
  /// Pose interpolated at `stamp`; nullopt outside the span, or when the neighboring poses are more
  /// than `max_gap` apart.
  std::optional<SE3> at(Stamp stamp, Duration max_gap) const;
};

}  // namespace apvi
