// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/known_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <set>
#include <utility>

#include "apvi/core/constants.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kCandidates = 16;  // places matched with an image without a prior pose
constexpr std::size_t kNear = 8;         // and with one
constexpr std::size_t kRivals = 4;       // more of them that are elsewhere
constexpr double kApart_m = 1.0;
constexpr std::size_t kMinFeatures = 8;
constexpr int kRefinements = 3;
constexpr double kSearchRadius = 0.1;                  // about a predicted ray, on the plane z = 1
constexpr int kMaxSquaredDistance = 300 * 300;         // of descriptors, whose norm is 512
constexpr double kMaxRatio = 0.85;                     // Lowe's ratio test among the features there
constexpr double kMinVisibleFraction = 0.2;            // of the points of a place
constexpr double kMaxTurn = 60.0 * kRadiansPerDegree;  // SIFT matches fail at larger view angles

std::size_t different_rays(const LevelView& view) {
  std::set<std::array<double, 2>> rays;
  for (const PointOnRay& s : view.seen) rays.insert({s.ray.x(), s.ray.y()});
  return rays.size();
}

LevelView selected(const LevelView& view, const std::vector<std::size_t>& indices) {
  LevelView part{view.T_world_camera, {}};
  for (const std::size_t i : indices) part.seen.push_back(view.seen[i]);
  return part;
}

// The feature near a ray whose descriptor is the most similar, and clearly so.
std::optional<std::size_t> nearest_feature(const Place& place, const Eigen::Vector2d& ray,
                                           const unsigned char* descriptor) {
  std::optional<std::size_t> nearest;
  int smallest = kMaxSquaredDistance;
  int second = kMaxSquaredDistance;
  for (std::size_t j = 0; j < place.rays.size(); ++j) {
    if ((place.rays[j] - ray).squaredNorm() > kSearchRadius * kSearchRadius) continue;
    const int distance = squared_distance(descriptor, place.descriptors.ptr(static_cast<int>(j)));
    if (distance < smallest) {
      second = std::exchange(smallest, distance);
      nearest = j;
    } else {
      second = std::min(second, distance);
    }
  }
  return smallest < kMaxRatio * kMaxRatio * second ? nearest : std::nullopt;
}

LevelView without(const LevelView& view, const std::vector<std::size_t>& indices) {
  LevelView rest{view.T_world_camera, {}};
  for (std::size_t i = 0; i < view.seen.size(); ++i) {
    if (!std::ranges::binary_search(indices, i)) rest.seen.push_back(view.seen[i]);
  }
  return rest;
}

}  // namespace

KnownMap::KnownMap(PlaceMap map, const CameraModel& camera, double pixel_sigma)
    : map_(std::move(map)),
      index_(map_),
      camera_(camera),
      sigma_(pixel_sigma / feature_camera(camera).parameters().fx) {
  for (const MapPlace& place : map_.places) places_.push_back(to_place(place));
}

LevelView KnownMap::match(const Place& place, const SE3& T_world_camera,
                          const std::vector<std::size_t>& places) const {
  LevelView view{T_world_camera, {}};
  for (const std::size_t k : places) {
    for (const auto& [i, j] : match_features(places_[k], place)) {
      const Eigen::Vector3d point =
          map_.places[k].T_map_camera *
          map_.places[k].points[static_cast<std::size_t>(i)].cast<double>();
      view.seen.push_back({point, place.rays[static_cast<std::size_t>(j)]});
    }
  }
  return view;
}

std::optional<MapFix> KnownMap::fix(const LevelView& seen) const {
  if (seen.seen.size() < kMinFeatures) return std::nullopt;
  const auto sampled = sample_level_pose(seen, sigma_);
  if (!sampled) return std::nullopt;
  MapFix fix{.pose = {.T_world_map = *sampled}, .view = {}, .features = 0};
  for (int k = 0; k < kRefinements; ++k) {
    fix.view = selected(seen, fitting_points(seen, fix.pose.T_world_map, sigma_));
    fix.features = different_rays(fix.view);
    if (fix.features < kMinFeatures) return std::nullopt;
    const auto fitted = fit_level_pose({fix.view}, fix.pose.T_world_map, sigma_);
    if (!fitted) return std::nullopt;
    fix.pose = *fitted;
  }
  return fix;
}

std::vector<MapFix> KnownMap::find(const Place& place, const SE3& T_world_camera) const {
  const std::vector<std::size_t> ranking = index_.query(place.descriptors, places_.size());
  const auto end =
      ranking.begin() + static_cast<std::ptrdiff_t>(std::min(ranking.size(), kCandidates));
  const LevelView seen = match(place, T_world_camera, {ranking.begin(), end});
  std::vector<MapFix> fixes;
  const auto best = fix(seen);
  if (!best) return fixes;
  const auto again = find_near(place, T_world_camera, best->pose.T_world_map);
  fixes.push_back(again && again->features > best->features ? *again : *best);
  LevelView rest = without(seen, fitting_points(seen, best->pose.T_world_map, sigma_));
  const SE3 T_map_camera = best->pose.T_world_map.inverse() * T_world_camera;
  const LevelView apart = match(place, T_world_camera, places_apart(ranking, T_map_camera));
  rest.seen.insert(rest.seen.end(), apart.seen.begin(), apart.seen.end());
  if (auto rival = fix(rest)) fixes.push_back(*std::move(rival));
  return fixes;
}

// The best ranked ones after the candidates that are not near a camera, so that one that looks
// alike is matched too.
std::vector<std::size_t> KnownMap::places_apart(const std::vector<std::size_t>& ranking,
                                                const SE3& T_map_camera) const {
  std::vector<std::size_t> apart;
  for (std::size_t k = kCandidates; k < ranking.size() && apart.size() < kRivals; ++k) {
    const Eigen::Vector3d& there = map_.places[ranking[k]].T_map_camera.translation;
    if ((there - T_map_camera.translation).norm() > kApart_m) apart.push_back(ranking[k]);
  }
  return apart;
}

std::optional<MapFix> KnownMap::find_near(const Place& place, const SE3& T_world_camera,
                                          const SE3& T_world_map) const {
  return fix(match_near(place, T_world_camera, T_world_map));
}

LevelView KnownMap::match_near(const Place& place, const SE3& T_world_camera,
                               const SE3& T_world_map) const {
  const SE3 T_map_camera = T_world_map.inverse() * T_world_camera;
  LevelView view{T_world_camera, {}};
  for (const std::size_t k : visible_places(T_map_camera)) {
    const SE3 T_camera_place = T_map_camera.inverse() * map_.places[k].T_map_camera;
    for (std::size_t i = 0; i < places_[k].points.size(); ++i) {
      const Eigen::Vector3d& point = *places_[k].points[i];
      const Eigen::Vector3d seen = T_camera_place * point;
      if (seen.z() <= 0.0) continue;
      const auto feature = nearest_feature(place, seen.hnormalized(),
                                           places_[k].descriptors.ptr(static_cast<int>(i)));
      if (!feature) continue;
      view.seen.push_back({map_.places[k].T_map_camera * point, place.rays[*feature]});
    }
  }
  return view;
}

// Those with the most expected matches first.
std::vector<std::size_t> KnownMap::visible_places(const SE3& T_map_camera) const {
  std::vector<std::pair<double, std::size_t>> visible;
  for (std::size_t k = 0; k < places_.size(); ++k) {
    const SE3 T_camera_place = T_map_camera.inverse() * map_.places[k].T_map_camera;
    if ((T_camera_place.rotation * Eigen::Vector3d::UnitZ()).z() < std::cos(kMaxTurn)) continue;
    double matches = 0.0;
    std::size_t in_image = 0;
    for (const auto& point : places_[k].points) {
      const Eigen::Vector3d seen = T_camera_place * *point;
      const auto pixel = camera_.project(seen);
      if (!pixel || !camera_.in_image(*pixel)) continue;
      ++in_image;
      matches += match_probability(T_camera_place.rotation * *point, seen);
    }
    const double fraction =
        static_cast<double>(in_image) / static_cast<double>(places_[k].points.size());
    if (fraction > kMinVisibleFraction) visible.emplace_back(matches, k);
  }
  std::ranges::stable_sort(visible, std::greater{}, &std::pair<double, std::size_t>::first);
  visible.resize(std::min(visible.size(), kNear));
  std::vector<std::size_t> best;
  for (const auto& [matches, k] : visible) best.push_back(k);
  return best;
}

}  // namespace apvi::loop_closure
