// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place_store.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "loop_closure/view_angle.hpp"

namespace apvi::loop_closure {
namespace {

// Minimum motion and time between stored places, so that their features have parallax.
constexpr double kMinStep_m = 0.25;
constexpr double kMinTurn = 10.0 * kRadiansPerDegree;
constexpr double kMinInterval_s = 0.5;

constexpr std::size_t kMaxCandidates = 3;
constexpr double kMinVisibleFraction = 0.3;            // of the triangulated points of a place
constexpr double kMaxTurn = 50.0 * kRadiansPerDegree;  // SIFT matches fail at larger view angles
// No camera farther from a place than this many times the distance of its points sees one of them
// at a similar distance.
constexpr double kMaxReach = 5.0;
constexpr std::size_t kMaxChecked = 24;  // places whose points are projected, the nearest ones

constexpr std::size_t kRecent = 4;  // places that still gain points
constexpr double kSpacingGrowth = 1.4;
constexpr double kKeptFraction = 0.75;  // of max_places, when places are thinned out

// A turn counts as much as a step between stored places.
bool is_same_view(const SE3& T_a_b, double spacing_m) {
  const double turn = angle_of_axes(T_a_b) * kMinStep_m / kMinTurn;
  return std::hypot(T_a_b.translation.norm(), turn) < spacing_m;
}

}  // namespace

PlaceStore::PlaceStore(const PlaceOptions& options, const CameraModel& camera, const cv::Mat& mask)
    : options_(options),
      camera_(camera),
      mask_(mask),
      ray_sigma_(options.pixel_sigma / feature_camera(camera).parameters().fx) {}

bool PlaceStore::is_new_place(const KeyframeGraph& graph) const {
  if (recent_.empty()) return true;
  const std::size_t last = recent_.back().keyframe;
  if (graph.age_s(last) < kMinInterval_s) return false;
  const SE3& here = graph[graph.newest()].T_world_camera;
  const SE3& there = graph[last].T_world_camera;
  return (here.translation - there.translation).norm() > kMinStep_m ||
         so3::angle_between(here.rotation, there.rotation) > kMinTurn;
}

Place PlaceStore::features(const cv::Mat& gray) const {
  return describe_place(gray, camera_, options_.max_features, mask_);
}

Place PlaceStore::describe(const KeyframeGraph& graph, const cv::Mat& gray) {
  Place place = features(gray);
  if (recent_.empty()) return place;
  const SE3& T_world_now = graph[graph.newest()].T_world_camera;
  const auto to_now = [&](const Stored& stored) {
    return T_world_now.inverse() * graph[stored.keyframe].T_world_camera;
  };
  Stored& last = recent_.back();
  triangulate_points(place, last.place, to_now(last).inverse(), ray_sigma_);
  triangulate_points(last.place, place, to_now(last), ray_sigma_);
  Stored& first = recent_.front();
  if (recent_.size() > 1) {
    retriangulate_points(first.place, place, to_now(first), ray_sigma_);
  }
  return place;
}

std::vector<PlaceStore::Near> PlaceStore::nearest(const KeyframeGraph& graph,
                                                  std::size_t first) const {
  const SE3 T_camera_world = graph.corrected_pose(graph.newest()).inverse();
  std::vector<Near> near;
  for (const Stored& stored : places_) {
    if (graph.age_s(stored.keyframe) < options_.min_age_s) break;
    if (stored.keyframe < first) continue;
    if (stored.triangulated < static_cast<std::size_t>(options_.min_inliers)) continue;
    const SE3 T_now_then = T_camera_world * graph.corrected_pose(stored.keyframe);
    const double distance = T_now_then.translation.norm();
    if (distance > kMaxReach * stored.reach_m || angle_of_axes(T_now_then) > kMaxTurn) continue;
    near.push_back({&stored, T_now_then, distance});
  }
  std::ranges::stable_sort(near, std::less{}, &Near::distance_m);
  if (near.size() > kMaxChecked) near.erase(near.begin() + kMaxChecked, near.end());
  return near;
}

std::vector<const PlaceStore::Stored*> PlaceStore::candidates(const KeyframeGraph& graph,
                                                              std::size_t first) const {
  struct Candidate {
    const Stored* stored = nullptr;
    double matches = 0.0;  ///< expected
  };
  std::vector<Candidate> found;
  for (const Near& near : nearest(graph, first)) {
    const VisiblePart visible = visible_part(near.stored->place, near.T_now_then, camera_);
    if (visible.fraction > kMinVisibleFraction) found.push_back({near.stored, visible.matches});
  }
  std::ranges::stable_sort(found, std::greater{}, &Candidate::matches);
  found.resize(std::min(found.size(), kMaxCandidates));
  std::vector<const Stored*> best;
  for (const Candidate& candidate : found) best.push_back(candidate.stored);
  return best;
}

void PlaceStore::store(const KeyframeGraph& graph, Place place) {
  recent_.push_back({graph.newest(), std::move(place)});
  if (recent_.size() <= kRecent) return;
  keep(graph, std::move(recent_.front()));
  recent_.pop_front();
}

void PlaceStore::end_path(const KeyframeGraph& graph) {
  for (Stored& stored : recent_) keep(graph, std::move(stored));
  recent_.clear();
}

void PlaceStore::keep(const KeyframeGraph& graph, Stored stored) {
  stored.triangulated = stored.place.triangulated_count();
  stored.reach_m = stored.place.reach_m();
  const SE3 T_camera_world = graph.corrected_pose(stored.keyframe).inverse();
  const bool known =
      spacing_m_ > 0.0 && std::ranges::any_of(places_, [&](const Stored& other) {
        return is_same_view(T_camera_world * graph.corrected_pose(other.keyframe), spacing_m_);
      });
  if (known) return;
  places_.push_back(std::move(stored));
  const auto most = static_cast<std::size_t>(options_.max_places);
  if (places_.size() > most) thin_out(graph);
}

void PlaceStore::thin_out(const KeyframeGraph& graph) {
  const auto target = static_cast<std::size_t>(kKeptFraction * options_.max_places);
  while (places_.size() > std::max<std::size_t>(1, target)) {
    spacing_m_ = std::max(kMinStep_m, kSpacingGrowth * spacing_m_);
    std::vector<SE3> kept;
    std::erase_if(places_, [&](const Stored& stored) {
      const SE3 T_world_camera = graph.corrected_pose(stored.keyframe);
      const bool known = std::ranges::any_of(kept, [&](const SE3& T_camera_world) {
        return is_same_view(T_camera_world * T_world_camera, spacing_m_);
      });
      if (!known) kept.push_back(T_world_camera.inverse());
      return known;
    });
  }
}

std::vector<const PlaceStore::Stored*> PlaceStore::all() const {
  std::vector<const Stored*> all;
  for (const Stored& stored : places_) all.push_back(&stored);
  for (const Stored& stored : recent_) all.push_back(&stored);
  return all;
}

}  // namespace apvi::loop_closure
