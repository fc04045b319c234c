// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/known_map.hpp"
#include "loop_closure/place_store.hpp"
#include "loop_closure/relocalizer.hpp"

namespace apvi::loop_closure {

/// Where the path after a break lies among the places before it.
struct Reconnection {
  SE3 T_map_odometry;       ///< from the odometry since the break to the corrected frame before it
  std::vector<Loop> loops;  ///< from places before the break to keyframes since then
  std::size_t points = 0;   ///< of the places, in all images that agree
};

/// After a break of the path, where odometry knows neither heading nor position anymore: finds the
/// keyframes since then in the places seen before, as a dive is found in the map of an earlier one.
class OwnMapSearch {
 public:
  /// The places before keyframe `first`, the first one after the break.
  OwnMapSearch(const PlaceStore& places, const KeyframeGraph& graph, std::size_t first,
               const CameraModel& camera, double pixel_sigma);

  /// The first keyframe after the break.
  std::size_t first() const { return first_; }
  /// The break goes on until this keyframe.
  void begin_at(std::size_t first) { first_ = first; }
  /// The newest keyframe, with its place. A result once enough images agree.
  std::optional<Reconnection> add(const Place& place, const KeyframeGraph& graph);

 private:
  struct MapPose {
    std::size_t keyframe = 0;
    SE3 T_map_camera;
  };

  Loop loop_to(const KnownKeyframe& image) const;

  std::size_t first_;
  std::vector<MapPose> places_;
  KnownMap map_;
  Relocalizer relocalizer_;
};

}  // namespace apvi::loop_closure
