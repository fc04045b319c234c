// SPDX-License-Identifier: BSD-3-Clause
#include "eval/association.hpp"

#include <algorithm>

namespace apvi::eval {
namespace {

using Iterator = std::vector<StampedPose>::const_iterator;

Iterator first_not_before(const Trajectory& trajectory, Stamp stamp) {
  return std::lower_bound(trajectory.poses.begin(), trajectory.poses.end(), stamp,
                          [](const StampedPose& pose, Stamp value) { return pose.stamp < value; });
}

std::ptrdiff_t count_within(const Trajectory& trajectory, Stamp from, Stamp to) {
  return first_not_before(trajectory, to + Duration{1}) - first_not_before(trajectory, from);
}

bool estimate_is_denser(const Trajectory& reference, const Trajectory& estimate) {
  const Stamp from = std::max(reference.poses.front().stamp, estimate.poses.front().stamp);
  const Stamp to = std::min(reference.poses.back().stamp, estimate.poses.back().stamp);
  return count_within(estimate, from, to) >= count_within(reference, from, to);
}

// The pose nearest in time; of two equally near, the earlier.
const StampedPose& nearest_to(const Trajectory& trajectory, Stamp stamp) {
  const Iterator after = first_not_before(trajectory, stamp);
  if (after == trajectory.poses.begin()) return *after;
  const Iterator before = std::prev(after);
  if (after == trajectory.poses.end()) return *before;
  return after->stamp - stamp < stamp - before->stamp ? *after : *before;
}

// For every pose of `sparse` that has a counterpart in `dense`: calls emit(stamp, sparse, dense).
template <typename Emit>
void match(const Trajectory& sparse, const Trajectory& dense, const AssociationOptions& options,
           const Emit& emit) {
  const Duration max_difference = Duration::from_seconds(options.max_difference_s);
  const Duration max_gap = Duration::from_seconds(options.max_gap_s);
  for (const StampedPose& pose : sparse.poses) {
    if (options.mode == Association::nearest) {
      const StampedPose& other = nearest_to(dense, pose.stamp);
      const Duration difference = other.stamp - pose.stamp;
      if (difference <= max_difference && -difference <= max_difference) {
        emit(pose.stamp, pose.T_world_body, other.T_world_body);
      }
    } else if (const auto other = dense.at(pose.stamp, max_gap)) {
      emit(pose.stamp, pose.T_world_body, *other);
    }
  }
}

}  // namespace

std::vector<PosePair> associate(const Trajectory& reference, const Trajectory& estimate,
                                const AssociationOptions& options) {
  std::vector<PosePair> pairs;
  if (reference.empty() || estimate.empty()) return pairs;
  const bool reference_is_sparse = options.mode == Association::nearest
                                       ? estimate.size() > reference.size()
                                       : estimate_is_denser(reference, estimate);
  if (reference_is_sparse) {
    match(reference, estimate, options, [&](Stamp stamp, const SE3& sparse, const SE3& dense) {
      pairs.push_back({.stamp = stamp, .reference = sparse, .estimate = dense});
    });
  } else {
    match(estimate, reference, options, [&](Stamp stamp, const SE3& sparse, const SE3& dense) {
      pairs.push_back({.stamp = stamp, .reference = dense, .estimate = sparse});
    });
  }
  return pairs;
}

double coverage(const Trajectory& reference, const Trajectory& estimate, double max_gap_s) {
  if (reference.empty() || estimate.empty()) return 0.0;
  const Stamp from = reference.poses.front().stamp;
  const Stamp to = reference.poses.back().stamp;
  if (from == to) return estimate.at(from, Duration::from_seconds(max_gap_s)) ? 1.0 : 0.0;
  double covered_s = 0.0;
  for (std::size_t i = 1; i < estimate.size(); ++i) {
    const Stamp begin = estimate.poses[i - 1].stamp;
    const Stamp end = estimate.poses[i].stamp;
    if (seconds_between(begin, end) > max_gap_s) continue;
    covered_s += std::max(0.0, seconds_between(std::max(begin, from), std::min(end, to)));
  }
  return std::min(1.0, covered_s / seconds_between(from, to));
}

}  // namespace apvi::eval
