// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/session_path.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kMaxReach = 0.5;  // between the cameras of a loop, of the reach of the place
constexpr std::size_t kLoopsPerPlace = 2;

Edge edge_to_next(const Session& session, const SessionPath& path, std::size_t node) {
  const double duration_s = seconds_between(path.stamp(node), path.stamp(node + 1));
  const DriftVariance drift = session.drift_per_s * duration_s;
  return {.from = node,
          .to = node + 1,
          .T_from_to = path.pose(node).inverse() * path.pose(node + 1),
          .sigmas = {.heading_rad = std::sqrt(drift.heading),
                     .horizontal_m = std::sqrt(drift.horizontal),
                     .vertical_m = std::sqrt(drift.vertical)}};
}

// Earlier places near a place, the nearest first.
std::vector<std::size_t> loop_candidates(const std::vector<MapPlace>& places,
                                         const std::vector<Place>& seen, std::size_t now) {
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t then = 0; then < now; ++then) {
    const double age_s = seconds_between(places[then].stamp, places[now].stamp);
    if (age_s < PlaceOptions{}.min_age_s) break;
    const double apart =
        (places[then].T_map_camera.translation - places[now].T_map_camera.translation).norm();
    if (apart < kMaxReach * seen[then].reach_m()) near.emplace_back(apart, then);
  }
  std::ranges::sort(near);
  near.resize(std::min(near.size(), kLoopsPerPlace));
  std::vector<std::size_t> nearest;
  for (const auto& [apart, then] : near) nearest.push_back(then);
  return nearest;
}

// Between the nodes nearest in time to two places.
Edge edge_of(const SessionPath& path, const MapPlace& then, const MapPlace& now,
             const SE3& T_then_now) {
  const std::size_t from = path.node_at(then.stamp);
  const std::size_t to = path.node_at(now.stamp);
  return {.from = from,
          .to = to,
          .T_from_to = path.pose(from).inverse() * then.T_map_camera * T_then_now *
                       now.T_map_camera.inverse() * path.pose(to),
          .sigmas = kLoopSigmas,
          .is_loop = true};
}

}  // namespace

SessionPath::SessionPath(const Trajectory& trajectory, double node_step_s, std::size_t max_nodes) {
  const std::vector<StampedPose>& poses = trajectory.poses;
  if (poses.empty()) fail_input("a session to merge has no trajectory; leave it out");
  const double duration_s = seconds_between(poses.front().stamp, poses.back().stamp);
  const double step_s = std::max(node_step_s, duration_s / static_cast<double>(max_nodes));
  for (const StampedPose& pose : poses) {
    const bool due = nodes_.empty() || seconds_between(nodes_.back().stamp, pose.stamp) >= step_s;
    if (due) nodes_.push_back(pose);
  }
  if (nodes_.back().stamp < poses.back().stamp) nodes_.push_back(poses.back());
  corrections_.resize(nodes_.size());
}

std::size_t SessionPath::node_at(Stamp stamp) const {
  const auto after = std::ranges::lower_bound(nodes_, stamp, {}, &StampedPose::stamp);
  if (after == nodes_.begin()) return 0;
  const auto node = static_cast<std::size_t>(after - nodes_.begin());
  if (after == nodes_.end()) return node - 1;
  return stamp - nodes_[node - 1].stamp < after->stamp - stamp ? node - 1 : node;
}

std::size_t SessionPath::node_near(const Eigen::Vector3d& position) const {
  const auto nearest = std::ranges::min_element(nodes_, {}, [&](const StampedPose& node) {
    return (node.T_world_body.translation - position).squaredNorm();
  });
  return static_cast<std::size_t>(nearest - nodes_.begin());
}

void SessionPath::place(const DriftCorrection& correction) {
  std::ranges::fill(corrections_, correction);
}

DriftCorrection SessionPath::correction(Stamp stamp) const {
  const auto after = std::ranges::lower_bound(nodes_, stamp, {}, &StampedPose::stamp);
  if (after == nodes_.begin()) return corrections_.front();
  if (after == nodes_.end()) return corrections_.back();
  const auto node = static_cast<std::size_t>(after - nodes_.begin());
  const DriftCorrection& a = corrections_[node - 1];
  const DriftCorrection& b = corrections_[node];
  const Stamp begin = nodes_[node - 1].stamp;
  const double part = seconds_between(begin, stamp) / seconds_between(begin, after->stamp);
  return {.heading = a.heading + part * (b.heading - a.heading),
          .translation = a.translation + part * (b.translation - a.translation)};
}

Trajectory SessionPath::corrected(const Trajectory& trajectory) const {
  Trajectory out = trajectory;
  for (StampedPose& pose : out.poses) {
    pose.T_world_body = correction(pose.stamp).transform() * pose.T_world_body;
  }
  return out;
}

std::vector<Edge> own_edges(const Session& session, const SessionPath& path, double gate) {
  PoseGraph graph;
  for (std::size_t node = 0; node < path.size(); ++node) {
    graph.odometry.push_back(path.pose(node));
    if (node + 1 < path.size()) graph.edges.push_back(edge_to_next(session, path, node));
  }
  const std::vector<DriftCorrection> none(path.size());
  std::optional<LinearGraph> linear;  // made anew after each loop that is added
  const std::vector<MapPlace>& places = session.places.places;
  std::vector<Place> seen;
  for (const MapPlace& place : places) seen.push_back(to_place(place));
  const double sigma = session.pixel_sigma / feature_camera(session.camera).parameters().fx;
  for (std::size_t now = 0; now < places.size(); ++now) {
    for (const std::size_t then : loop_candidates(places, seen, now)) {
      const auto match = recognize_place(seen[then], seen[now], sigma, PlaceOptions{}.min_inliers);
      if (!match) continue;
      const Edge loop = edge_of(path, places[then], places[now], match->T_now_then.inverse());
      if (loop.from == loop.to) continue;
      if (!linear) linear.emplace(graph, none);
      if (!(linear->check(loop).squared_distance < gate)) continue;  // nor NaN
      graph.edges.push_back(loop);
      linear.reset();
    }
  }
  return graph.edges;
}

}  // namespace apvi::loop_closure
