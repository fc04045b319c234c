// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <optional>

#include "apvi/core/stamp.hpp"
#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/known_map.hpp"
#include "loop_closure/relocalizer.hpp"

namespace apvi::loop_closure {

/// How a dive was found in a known map.
struct FoundInMap {
  Stamp stamp;               ///< of the deciding image
  std::size_t images = 0;    ///< that agreed
  std::size_t features = 0;  ///< of the deciding image that fit
  std::size_t points = 0;    ///< of the map, in all these images
  SE3 T_known_camera;        ///< at the deciding image
  /// Of that pose, by the points alone: position in the known map [m], heading [rad].
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
};

/// The fix of a keyframe as an edge, with what errors of the points add to its own covariance.
Anchor anchor_of(std::size_t keyframe, const MapFix& fix);

/// Finds a dive in a known map, then keeps its graph anchored there.
class MapAnchors {
 public:
  /// `gate`: largest squared Mahalanobis distance of an anchor from the graph.
  MapAnchors(std::shared_ptr<const KnownMap> map, double gate);

  bool is_searching() const { return !found_; }
  /// The newest keyframe of the graph, with its place. True if the graph has got an anchor.
  bool process(const Place& place, KeyframeGraph& graph);

  const std::optional<FoundInMap>& found() const { return found_; }
  /// Number of keyframes that anchor the graph, and of those that it contradicts.
  std::size_t anchors() const { return anchors_; }
  std::size_t rejected() const { return rejected_; }

 private:
  bool search(const Place& place, KeyframeGraph& graph);
  bool anchor(const Place& place, KeyframeGraph& graph);

  std::shared_ptr<const KnownMap> map_;
  Relocalizer relocalizer_;
  double gate_;
  std::optional<FoundInMap> found_;
  std::size_t anchors_ = 0;
  std::size_t rejected_ = 0;
};

}  // namespace apvi::loop_closure
