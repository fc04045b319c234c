// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/own_map_search.hpp"

#include <algorithm>

#include "loop_closure/map_anchors.hpp"

namespace apvi::loop_closure {
namespace {

// Without triangulating anew, which takes seconds for a long dive.
MapPlace to_map_place(const Place& place, const SE3& T_map_camera) {
  MapPlace result{{}, T_map_camera, {}, {}};
  for (std::size_t i = 0; i < place.points.size(); ++i) {
    if (!place.points[i]) continue;
    result.points.emplace_back(place.points[i]->cast<float>());
    result.descriptors.push_back(place.descriptors.row(static_cast<int>(i)));
  }
  return result;
}

PlaceMap map_of(const PlaceStore& places, const KeyframeGraph& graph) {
  PlaceMap map;
  for (const PlaceStore::Stored* stored : places.all()) {
    MapPlace place = to_map_place(stored->place, graph.corrected_pose(stored->keyframe));
    if (!place.points.empty()) map.places.push_back(std::move(place));
  }
  return map;
}

}  // namespace

OwnMapSearch::OwnMapSearch(const PlaceStore& places, const KeyframeGraph& graph, std::size_t first,
                           const CameraModel& camera, double pixel_sigma)
    : first_(first), map_(map_of(places, graph), camera, pixel_sigma), relocalizer_(map_.sigma()) {
  for (const PlaceStore::Stored* stored : places.all()) {
    places_.push_back({stored->keyframe, graph.corrected_pose(stored->keyframe)});
  }
}

std::optional<Reconnection> OwnMapSearch::add(const Place& place, const KeyframeGraph& graph) {
  const std::size_t newest = graph.newest();
  const auto found = relocalizer_.add(newest, map_.find(place, graph[newest].T_world_camera));
  if (!found) return std::nullopt;
  Reconnection result{
      .T_map_odometry = found->pose.T_world_map.inverse(), .loops = {}, .points = found->points};
  for (const KnownKeyframe& image : found->images) result.loops.push_back(loop_to(image));
  return result;
}

// From the place whose camera was the nearest.
Loop OwnMapSearch::loop_to(const KnownKeyframe& image) const {
  const Anchor anchor = anchor_of(image.keyframe, image.fix);
  const auto nearest = std::ranges::min_element(places_, {}, [&](const MapPose& place) {
    return (place.T_map_camera.translation - anchor.T_known_camera.translation).squaredNorm();
  });
  return {.from = nearest->keyframe,
          .to = image.keyframe,
          .T_from_to = nearest->T_map_camera.inverse() * anchor.T_known_camera,
          .sigmas = anchor.sigmas};
}

}  // namespace apvi::loop_closure
