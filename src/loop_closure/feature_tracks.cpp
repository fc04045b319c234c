// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/feature_tracks.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "loop_closure/view_angle.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kNext = 3;      // views on either side that are matched
constexpr std::size_t kOverlaps = 8;  // earlier ones beside them
constexpr std::size_t kMaxChecked = 24;
constexpr double kMinMatches = 10.0;  // expected
// Matches of a pair that agree with its poses; fewer may be chance.
constexpr double kMinAgreeing = 15.0;
constexpr double kMinAgreeingShare = 0.5;
constexpr double kMaxTurn = 50.0 * kRadiansPerDegree;
constexpr double kMaxReach = 5.0;

using Pair = std::pair<std::size_t, std::size_t>;

struct Candidate {
  std::size_t view = 0;
  double measure = 0.0;
};

std::vector<Candidate> nearest_views(const std::vector<TrackView>& views,
                                     const std::vector<double>& reach_m, std::size_t now) {
  const SE3 T_camera_world = views[now].T_world_camera.inverse();
  std::vector<Candidate> near;
  for (std::size_t then = 0; then + kNext < now; ++then) {
    const SE3 T_now_then = T_camera_world * views[then].T_world_camera;
    const double distance = T_now_then.translation.norm();
    if (distance > kMaxReach * reach_m[then] || angle_of_axes(T_now_then) > kMaxTurn) continue;
    near.push_back({then, distance});
  }
  std::ranges::stable_sort(near, std::less{}, &Candidate::measure);
  near.resize(std::min(near.size(), kMaxChecked));
  return near;
}

/// Sets of features, each with its views in order, joined by matches (union-find).
class TrackSets {
 public:
  explicit TrackSets(const std::vector<TrackView>& views) {
    for (std::size_t v = 0; v < views.size(); ++v) {
      first_.push_back(parents_.size());
      for (std::size_t f = 0; f < views[v].place->rays.size(); ++f) {
        parents_.push_back(parents_.size());
        members_.push_back({{v, f}});
      }
    }
  }

  void join(const TrackedFeature& a, const TrackedFeature& b) {
    std::size_t to = root(first_[a.view] + a.feature);
    std::size_t from = root(first_[b.view] + b.feature);
    if (to == from || share_a_view(members_[to], members_[from])) return;
    if (members_[to].size() < members_[from].size()) std::swap(to, from);
    FeatureTrack joined;
    std::ranges::merge(members_[to], members_[from], std::back_inserter(joined), std::less{},
                       &TrackedFeature::view, &TrackedFeature::view);
    members_[to] = std::move(joined);
    members_[from].clear();
    parents_[from] = to;
  }

  std::vector<FeatureTrack> tracks() && {
    std::erase_if(members_, [](const FeatureTrack& track) { return track.size() < 2; });
    return std::move(members_);
  }

 private:
  std::size_t root(std::size_t node) {
    while (parents_[node] != node) {
      parents_[node] = parents_[parents_[node]];
      node = parents_[node];
    }
    return node;
  }
  static bool share_a_view(const FeatureTrack& a, const FeatureTrack& b) {
    return std::ranges::any_of(a, [&](const TrackedFeature& feature) {
      return std::ranges::binary_search(b, feature.view, std::less{}, &TrackedFeature::view);
    });
  }

  std::vector<std::size_t> first_;  ///< node of the first feature of a view
  std::vector<std::size_t> parents_;
  std::vector<FeatureTrack> members_;  ///< of the roots
};

// Distance of a ray from the epipolar line of another on the plane z = 1.
double epipolar_distance(const Eigen::Matrix3d& E, const Eigen::Vector2d& then,
                         const Eigen::Vector2d& now) {
  const Eigen::Vector3d line = E * then.homogeneous();
  return std::abs(line.dot(now.homogeneous())) / std::max(1e-12, line.head<2>().norm());
}

// Empty if too few agree with the poses.
std::vector<std::pair<TrackedFeature, TrackedFeature>> matches_of(
    const std::vector<TrackView>& views, const Pair& pair, double tolerance) {
  const auto& [a, b] = pair;
  const SE3 T_b_a = views[b].T_world_camera.inverse() * views[a].T_world_camera;
  const Eigen::Matrix3d E = so3::hat(T_b_a.translation) * T_b_a.rotation.toRotationMatrix();
  const auto all = match_features(*views[a].place, *views[b].place);
  std::vector<std::pair<TrackedFeature, TrackedFeature>> agreeing;
  for (const auto& [i, j] : all) {
    const TrackedFeature then{a, static_cast<std::size_t>(i)};
    const TrackedFeature now{b, static_cast<std::size_t>(j)};
    if (epipolar_distance(E, views[a].place->rays[then.feature],
                          views[b].place->rays[now.feature]) < tolerance) {
      agreeing.emplace_back(then, now);
    }
  }
  const double enough = std::max(kMinAgreeing, kMinAgreeingShare * static_cast<double>(all.size()));
  if (static_cast<double>(agreeing.size()) < enough) agreeing.clear();
  return agreeing;
}

}  // namespace

std::vector<Pair> overlapping_views(const std::vector<TrackView>& views,
                                    const CameraModel& camera) {
  std::vector<double> reach_m;
  for (const TrackView& view : views) reach_m.push_back(view.place->reach_m());
  std::vector<Pair> pairs;
  for (std::size_t now = 1; now < views.size(); ++now) {
    for (std::size_t then = now - std::min(now, kNext); then < now; ++then) {
      pairs.emplace_back(then, now);
    }
    std::vector<Candidate> shared;
    for (const Candidate& near : nearest_views(views, reach_m, now)) {
      const SE3 T_now_then = views[now].T_world_camera.inverse() * views[near.view].T_world_camera;
      const double matches = visible_part(*views[near.view].place, T_now_then, camera).matches;
      if (matches > kMinMatches) shared.push_back({near.view, matches});
    }
    std::ranges::stable_sort(shared, std::greater{}, &Candidate::measure);
    shared.resize(std::min(shared.size(), kOverlaps));
    for (const Candidate& candidate : shared) pairs.emplace_back(candidate.view, now);
  }
  return pairs;
}

std::vector<FeatureTrack> track_features(const std::vector<TrackView>& views,
                                         const std::vector<Pair>& pairs, double tolerance) {
  TrackSets sets(views);
  for (const Pair& pair : pairs) {
    for (const auto& [then, now] : matches_of(views, pair, tolerance)) sets.join(then, now);
  }
  return std::move(sets).tracks();
}

}  // namespace apvi::loop_closure
