// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/trajectory.hpp"

#include <algorithm>

namespace apvi {

double Trajectory::path_length() const {
  double length = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    length += (poses[i].T_world_body.translation - poses[i - 1].T_world_body.translation).norm();
  }
  return length;
}

void Trajectory::merge(const std::vector<StampedPose>& added) {
  for (const StampedPose& pose : added) {
    const auto place =
        std::lower_bound(poses.begin(), poses.end(), pose.stamp,
                         [](const StampedPose& kept, Stamp stamp) { return kept.stamp < stamp; });
    if (place != poses.end() && place->stamp == pose.stamp) {
      *place = pose;
    } else {
      poses.insert(place, pose);
    }
  }
}

std::optional<SE3> Trajectory::at(Stamp stamp, Duration max_gap) const {
  const auto after =
      std::lower_bound(poses.begin(), poses.end(), stamp,
                       [](const StampedPose& pose, Stamp value) { return pose.stamp < value; });
  if (after == poses.end()) return std::nullopt;
  if (after->stamp == stamp) return after->T_world_body;
  if (after == poses.begin()) return std::nullopt;
  const auto before = std::prev(after);
  if (after->stamp - before->stamp > max_gap) return std::nullopt;
  const double u =
      seconds_between(before->stamp, stamp) / seconds_between(before->stamp, after->stamp);
  return interpolate(before->T_world_body, after->T_world_body, u);
}

}  // namespace apvi
