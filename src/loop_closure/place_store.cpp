// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place_store.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

// Minimum motion and time between stored places, so that their features have parallax.
constexpr double kMinStep_m = 0.25;
constexpr double kMinTurn = 10.0 * kRadiansPerDegree;
constexpr double kMinInterval_s = 0.5;

constexpr std::size_t kMaxCandidates = 3;
constexpr double kMinVisibleFraction = 0.3;            // of the triangulated points of a place
constexpr double kMaxTurn = 50.0 * kRadiansPerDegree;  // SIFT matches fail at larger view angles
constexpr double kMaxDistanceRatio = 2.0;  // limit on the change of distance, either way
// No camera farther from a place than this many times the distance of its points sees one of them
// at a similar distance.
constexpr double kMaxReach = 5.0;

}  // namespace

PlaceStore::PlaceStore(const PlaceOptions& options, const CameraModel& camera)
    : options_(options),
      camera_(camera),
      ray_sigma_(options.pixel_sigma / camera.parameters().fx) {}

bool PlaceStore::is_new_place(const KeyframeGraph& graph) const {
  if (places_.empty()) return true;
  const std::size_t last = places_.back().keyframe;
  if (graph.age_s(last) < kMinInterval_s) return false;
  const SE3& here = graph[graph.newest()].T_world_camera;
  const SE3& there = graph[last].T_world_camera;
  return (here.translation - there.translation).norm() > kMinStep_m ||
         so3::angle_between(here.rotation, there.rotation) > kMinTurn;
}

Place PlaceStore::features(const cv::Mat& gray) const {
  return describe_place(gray, camera_, options_.max_features);
}

Place PlaceStore::describe(const KeyframeGraph& graph, const cv::Mat& gray) {
  Place place = features(gray);
  if (places_.empty()) return place;
  Stored& last = places_.back();
  const SE3 T_last_now =
      graph[last.keyframe].T_world_camera.inverse() * graph[graph.newest()].T_world_camera;
  triangulate_points(place, last.place, T_last_now, ray_sigma_);
  triangulate_points(last.place, place, T_last_now.inverse(), ray_sigma_);
  return place;
}

// Fraction of the triangulated points of a place that would be in the image at a similar distance.
double PlaceStore::visible_fraction(const Place& place, const SE3& T_now_then) const {
  if ((T_now_then.rotation * Eigen::Vector3d::UnitZ()).z() < std::cos(kMaxTurn)) return 0.0;
  if (T_now_then.translation.norm() > kMaxReach * place.reach_m()) return 0.0;
  std::size_t in_image = 0;
  for (const auto& point : place.points) {
    if (!point) continue;
    const Eigen::Vector3d p = T_now_then * *point;
    if (p.z() * kMaxDistanceRatio < point->z() || p.z() > kMaxDistanceRatio * point->z()) continue;
    const auto pixel = camera_.project(p);
    if (pixel && camera_.in_image(*pixel)) ++in_image;
  }
  return static_cast<double>(in_image) /
         static_cast<double>(std::max<std::size_t>(1, place.triangulated_count()));
}

std::vector<const PlaceStore::Stored*> PlaceStore::candidates(const KeyframeGraph& graph) const {
  struct Candidate {
    const Stored* stored = nullptr;
    double visible_fraction = 0.0;
  };
  const SE3 T_camera_world = graph.corrected_pose(graph.newest()).inverse();
  std::vector<Candidate> found;
  for (const Stored& stored : places_) {
    if (graph.age_s(stored.keyframe) < options_.min_age_s) break;
    if (stored.place.triangulated_count() < static_cast<std::size_t>(options_.min_inliers))
      continue;
    const double fraction =
        visible_fraction(stored.place, T_camera_world * graph.corrected_pose(stored.keyframe));
    if (fraction > kMinVisibleFraction) found.push_back({&stored, fraction});
  }
  std::ranges::stable_sort(found, std::greater{}, &Candidate::visible_fraction);
  found.resize(std::min(found.size(), kMaxCandidates));
  std::vector<const Stored*> best;
  for (const Candidate& candidate : found) best.push_back(candidate.stored);
  return best;
}

void PlaceStore::store(std::size_t keyframe, Place place) {
  places_.push_back({keyframe, std::move(place)});
  if (places_.size() <= static_cast<std::size_t>(options_.max_places)) return;
  for (std::size_t k = 1; 2 * k < places_.size(); ++k) places_[k] = std::move(places_[2 * k]);
  places_.resize((places_.size() + 1) / 2);
}

}  // namespace apvi::loop_closure
