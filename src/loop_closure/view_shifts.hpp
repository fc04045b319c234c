// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "loop_closure/keyframe_graph.hpp"

namespace apvi::loop_closure {

/// What a bundle adjustment adds to the corrected poses of a pose graph: how far its views move.
/// Between two views it is linear in time, and before the first and after the last one it is
/// theirs. It does not reach over a break of the path.
class ViewShifts {
 public:
  /// Moves a keyframe; in order of time.
  void add(std::size_t keyframe, const SE3& T_world_before, const SE3& T_world_after);
  void clear() { shifts_.clear(); }
  /// A pose at the time of a keyframe of the graph, moved.
  SE3 moved(const KeyframeGraph& graph, std::size_t keyframe, const SE3& T_world_camera) const;

 private:
  struct Shift {
    std::size_t keyframe = 0;
    Eigen::Vector3d turn = Eigen::Vector3d::Zero();    ///< rotation vector in the world [rad]
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();  ///< [m]
  };
  std::optional<Shift> at(const KeyframeGraph& graph, std::size_t keyframe) const;

  std::vector<Shift> shifts_;
};

}  // namespace apvi::loop_closure
