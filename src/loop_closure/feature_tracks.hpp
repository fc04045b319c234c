// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "loop_closure/place.hpp"

namespace apvi::loop_closure {

/// A place with the pose of its camera.
struct TrackView {
  const Place* place = nullptr;
  SE3 T_world_camera;
};

/// A feature of a view, both by index.
struct TrackedFeature {
  std::size_t view = 0;
  std::size_t feature = 0;
};

/// Features of different views that show the same point, in order of view.
using FeatureTrack = std::vector<TrackedFeature>;

/// Pairs of views to be matched, the earlier one first: those next to each other, and for each view
/// the earlier ones that share most of what it sees.
std::vector<std::pair<std::size_t, std::size_t>> overlapping_views(
    const std::vector<TrackView>& views, const CameraModel& camera);

/// Matches the pairs and joins the matches. A match counts if its rays meet within `tolerance` on
/// the plane z = 1, by the poses of the views. One that would join two features of the same view
/// is left out.
std::vector<FeatureTrack> track_features(
    const std::vector<TrackView>& views,
    const std::vector<std::pair<std::size_t, std::size_t>>& pairs, double tolerance);

}  // namespace apvi::loop_closure
