// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/bundle_views.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kMinSigma = 1e-5;
// Errors that a hundred motions share do not average out: each counts as one hundredth.
constexpr double kSharedErrors = 10.0;

// Of the mounting of the camera at a keyframe, by that of the newest one [rad].
double mounting_error(const KeyframeGraph& graph, std::size_t keyframe) {
  return so3::angle_between(graph[keyframe].T_body_camera.rotation,
                            graph[graph.newest()].T_body_camera.rotation);
}

// `error`: of the direction of the motion, relative.
EdgeSigmas motion_sigmas(const EdgeSigmas& drift, const SE3& motion, double error) {
  const double moved = error * motion.translation.norm();
  const double turned = error * so3::angle_between(motion.rotation, Eigen::Quaterniond::Identity());
  return {.heading_rad = std::max(kMinSigma, std::hypot(drift.heading_rad, turned)),
          .horizontal_m = std::max(kMinSigma, std::hypot(drift.horizontal_m, moved)),
          .vertical_m = std::max(kMinSigma, std::hypot(drift.vertical_m, moved))};
}

ViewMotion motion_of(const KeyframeGraph& graph, std::size_t before, std::size_t now,
                     double drift_factor) {
  const SE3 motion =
      graph[before].T_body_camera * graph.motion(before, now) * graph[now].T_body_camera.inverse();
  const EdgeSigmas drift = graph.drift(before, now);
  const EdgeSigmas reported{.heading_rad = drift.heading_rad / drift_factor,
                            .horizontal_m = drift.horizontal_m / drift_factor,
                            .vertical_m = drift.vertical_m / drift_factor};
  return {motion, motion_sigmas(reported, motion, kSharedErrors * mounting_error(graph, now))};
}

// The anchors of a known map, each at the next place.
void add_fixes(const KeyframeGraph& graph, const std::vector<const PlaceStore::Stored*>& places,
               std::vector<BundleView>& views) {
  for (const Anchor& anchor : graph.anchors()) {
    const auto next = std::ranges::lower_bound(places, anchor.keyframe, std::less{},
                                               &PlaceStore::Stored::keyframe);
    if (next == places.end()) continue;
    const std::size_t k = (*next)->keyframe;
    const SE3 T_known_camera = anchor.T_known_camera * graph.motion(anchor.keyframe, k);
    views[static_cast<std::size_t>(next - places.begin())].fixes.push_back(
        {graph.T_world_known() * T_known_camera, anchor.sigmas});
  }
}

}  // namespace

std::vector<BundleView> bundle_views(const KeyframeGraph& graph,
                                     const std::vector<const PlaceStore::Stored*>& places,
                                     double drift_factor) {
  std::vector<BundleView> views;
  for (const PlaceStore::Stored* stored : places) {
    const std::size_t k = stored->keyframe;
    const SE3 T_camera_body = graph[k].T_body_camera.inverse();
    BundleView view;
    view.place = &stored->place;
    view.T_world_body = graph.corrected_pose(k) * T_camera_body;
    view.T_odometry_body = graph[k].T_world_camera * T_camera_body;
    view.tilt_error = mounting_error(graph, k);
    if (!views.empty()) {
      view.motion = motion_of(graph, places[views.size() - 1]->keyframe, k, drift_factor);
    }
    if (graph[k].height_sigma_m) {
      view.height = ViewHeight{view.T_odometry_body.translation.z(),
                               std::max(kMinSigma, *graph[k].height_sigma_m)};
    }
    views.push_back(std::move(view));
  }
  add_fixes(graph, places, views);
  return views;
}

}  // namespace apvi::loop_closure
