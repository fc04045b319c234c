// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/relocalizer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kMaxImages = 16;  // remembered
constexpr std::size_t kMinImages = 3;   // that agree
constexpr std::size_t kMinPoints = 25;  // of the map, in all of them
constexpr std::size_t kMaxShare = 3;    // at least one of so many images agrees
// A rival must have fewer points than this part of the best one's.
constexpr double kRivalPart = 0.5;
// Two fixes agree within these limits, which are wide: some have few points.
constexpr double kMaxShift_m = 0.25;
constexpr double kMaxTurn = 5.0 * kRadiansPerDegree;
// Points in one cube of this size are counted once: places have them in common.
constexpr double kCube_m = 0.1;

// Of the camera in the map, by two poses of the map.
bool agree(const SE3& a, const SE3& b, const Eigen::Vector3d& camera) {
  const double shift = (a.inverse() * camera - b.inverse() * camera).norm();
  return shift < kMaxShift_m && so3::angle_between(a.rotation, b.rotation) < kMaxTurn;
}

std::size_t different_points(const std::vector<KnownKeyframe>& images) {
  std::set<std::array<std::int64_t, 3>> cubes;
  for (const KnownKeyframe& image : images) {
    for (const PointOnRay& s : image.fix.view.seen) {
      const Eigen::Vector3d cube = (s.point / kCube_m).array().floor();
      cubes.insert({static_cast<std::int64_t>(cube.x()), static_cast<std::int64_t>(cube.y()),
                    static_cast<std::int64_t>(cube.z())});
    }
  }
  return cubes.size();
}

const Eigen::Vector3d& camera_of(const MapFix& fix) {
  return fix.view.T_world_camera.translation;
}

}  // namespace

Relocalizer::Hypothesis Relocalizer::supporters(const MapFix& fix) const {
  Hypothesis hypothesis;
  for (const Image& image : images_) {
    const auto found = std::ranges::find_if(image.fixes, [&](const MapFix& other) {
      return agree(fix.pose.T_world_map, other.pose.T_world_map, camera_of(other));
    });
    if (found != image.fixes.end()) hypothesis.images.push_back({image.keyframe, *found});
  }
  hypothesis.points = different_points(hypothesis.images);
  return hypothesis;
}

// Of the best supported place that contradicts a pose of the map.
std::size_t Relocalizer::rival_points(const SE3& T_world_map, const Eigen::Vector3d& camera) const {
  std::size_t most = 0;
  for (const Image& image : images_) {
    for (const MapFix& fix : image.fixes) {
      if (agree(T_world_map, fix.pose.T_world_map, camera)) continue;
      most = std::max(most, supporters(fix).points);
    }
  }
  return most;
}

std::size_t Relocalizer::images_since(std::size_t keyframe) const {
  return static_cast<std::size_t>(std::ranges::count_if(
      images_, [keyframe](const Image& image) { return image.keyframe >= keyframe; }));
}

std::optional<Relocalization> Relocalizer::joined(const Hypothesis& hypothesis) const {
  std::vector<LevelView> views;
  for (const KnownKeyframe& image : hypothesis.images) views.push_back(image.fix.view);
  const auto pose = fit_level_pose(views, hypothesis.images.back().fix.pose.T_world_map, sigma_);
  if (!pose) return std::nullopt;
  return Relocalization{*pose, hypothesis.images, hypothesis.points};
}

std::optional<Relocalization> Relocalizer::add(std::size_t keyframe, std::vector<MapFix> fixes) {
  images_.push_back({keyframe, std::move(fixes)});
  if (images_.size() > kMaxImages) images_.pop_front();
  const std::vector<MapFix> newest = images_.back().fixes;
  if (newest.empty()) return std::nullopt;
  const MapFix& fix = newest.front();
  const Hypothesis best = supporters(fix);
  if (best.images.size() < kMinImages || best.points < kMinPoints) return std::nullopt;
  if (kMaxShare * best.images.size() < images_since(best.images.front().keyframe)) {
    return std::nullopt;
  }
  const auto rival = static_cast<double>(rival_points(fix.pose.T_world_map, camera_of(fix)));
  if (rival >= kRivalPart * static_cast<double>(best.points)) return std::nullopt;
  return joined(best);
}

}  // namespace apvi::loop_closure
