// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/loop_closer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/core/log.hpp"
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

const EdgeSigmas kLoopSigmas{
    .heading_rad = 0.05 * kRadiansPerDegree, .horizontal_m = 0.007, .vertical_m = 0.007};
constexpr double kVerticalDriftRatio = 0.25;  // relative to horizontal drift: pressure bounds it
constexpr double kKnownLoopSigmas = 2.0;      // a loop with a smaller error adds no information
constexpr double kOptimizationPeriod_s = 4.0;
constexpr double kNodeStep_s = 4.0;  // at most half of the minimum loop age

// Plausibility limits from the drift of DVL odometry; larger errors indicate a similar but
// different place.
constexpr double kMaxTilt = 3.0 * kRadiansPerDegree;
constexpr double kMaxHeading = 20.0 * kRadiansPerDegree;
constexpr double kMaxVertical_m = 0.5;
constexpr double kMaxHorizontal_m = 0.5;
constexpr double kMaxPathFraction = 0.05;

// Smaller corrections move no pixel and are not reported.
constexpr double kMinReportedShift_m = 1e-3;
constexpr double kMinReportedTurn = 2e-4;

}  // namespace

LoopCloser::LoopCloser(const LoopOptions& options, const Pinhole& camera)
    : options_(options), camera_(camera) {}

double LoopCloser::age_s(std::size_t keyframe) const {
  return seconds_between(keyframes_[keyframe].stamp, keyframes_.back().stamp);
}

void LoopCloser::add_keyframe(Stamp stamp, const SE3& T_world_camera) {
  const std::size_t index = keyframes_.size();
  by_stamp_[stamp] = index;
  keyframes_.push_back(
      {stamp, T_world_camera, keyframes_.empty() ? DriftCorrection{} : keyframes_.back().reported});
  if (!nodes_.empty() && age_s(nodes_.back()) < kNodeStep_s) return;
  nodes_.push_back(index);
  corrections_.push_back(corrections_.empty() ? DriftCorrection{} : corrections_.back());
}

void LoopCloser::update_pose(Stamp stamp, const SE3& T_world_camera) {
  const auto known = by_stamp_.find(stamp);
  if (known != by_stamp_.end()) keyframes_[known->second].T_world_camera = T_world_camera;
}

std::size_t LoopCloser::nearest_node(std::size_t keyframe) const {
  const auto next = std::upper_bound(nodes_.begin(), nodes_.end(), keyframe);
  const auto before = static_cast<std::size_t>(next - nodes_.begin()) - 1;
  if (next == nodes_.end()) return before;
  const Stamp stamp = keyframes_[keyframe].stamp;
  const bool nearer = seconds_between(keyframes_[nodes_[before]].stamp, stamp) <
                      seconds_between(stamp, keyframes_[*next].stamp);
  return nearer ? before : before + 1;
}

// Linear interpolation between nodes, so that the error of a single loop does not distort the path
// between neighboring keyframes.
DriftCorrection LoopCloser::correction(std::size_t keyframe) const {
  const auto next = std::upper_bound(nodes_.begin(), nodes_.end(), keyframe);
  const auto before = static_cast<std::size_t>(next - nodes_.begin()) - 1;
  const DriftCorrection& a = corrections_[before];
  if (next == nodes_.end()) return a;
  const DriftCorrection& b = corrections_[before + 1];
  const Stamp begin = keyframes_[nodes_[before]].stamp;
  const double part = seconds_between(begin, keyframes_[keyframe].stamp) /
                      seconds_between(begin, keyframes_[*next].stamp);
  return {.heading = a.heading + part * (b.heading - a.heading),
          .translation = a.translation + part * (b.translation - a.translation)};
}

SE3 LoopCloser::corrected_pose(std::size_t keyframe) const {
  return correction(keyframe).transform() * keyframes_[keyframe].T_world_camera;
}

bool LoopCloser::is_new_place() const {
  if (places_.empty()) return true;
  const std::size_t last = places_.back().keyframe;
  if (age_s(last) < kMinInterval_s) return false;
  const SE3& here = keyframes_.back().T_world_camera;
  const SE3& there = keyframes_[last].T_world_camera;
  return (here.translation - there.translation).norm() > kMinStep_m ||
         so3::angle_between(here.rotation, there.rotation) > kMinTurn;
}

// Fraction of the triangulated points of a place that would be in the image at a similar distance.
double LoopCloser::visible_fraction(const StoredPlace& stored, const SE3& T_camera_world) const {
  const SE3 T_now_then = T_camera_world * corrected_pose(stored.keyframe);
  if ((T_now_then.rotation * Eigen::Vector3d::UnitZ()).z() < std::cos(kMaxTurn)) return 0.0;
  std::size_t in_image = 0;
  for (const auto& point : stored.place.points) {
    if (!point) continue;
    const Eigen::Vector3d p = T_now_then * *point;
    if (p.z() * kMaxDistanceRatio < point->z() || p.z() > kMaxDistanceRatio * point->z()) continue;
    const double u = camera_.fx * p.x() / p.z() + camera_.cx;
    const double v = camera_.fy * p.y() / p.z() + camera_.cy;
    if (u > 0.0 && v > 0.0 && u < camera_.width && v < camera_.height) ++in_image;
  }
  return static_cast<double>(in_image) /
         static_cast<double>(std::max<std::size_t>(1, stored.place.triangulated_count()));
}

std::vector<LoopCloser::Candidate> LoopCloser::candidates() const {
  const SE3 T_camera_world = corrected_pose(keyframes_.size() - 1).inverse();
  std::vector<Candidate> found;
  for (const StoredPlace& stored : places_) {
    if (age_s(stored.keyframe) < options_.min_age_s) break;
    if (stored.place.triangulated_count() < static_cast<std::size_t>(options_.min_inliers))
      continue;
    const double fraction = visible_fraction(stored, T_camera_world);
    if (fraction > kMinVisibleFraction) found.push_back({&stored, fraction});
  }
  std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) {
    return a.visible_fraction > b.visible_fraction;
  });
  found.resize(std::min(found.size(), kMaxCandidates));
  return found;
}

bool LoopCloser::is_plausible(const Loop& loop) const {
  const SE3 predicted = corrected_pose(loop.to);
  const SE3 found = corrected_pose(loop.from) * loop.T_from_to;
  const Eigen::Vector3d offset = found.translation - predicted.translation;
  const Eigen::Quaterniond turned = found.rotation * predicted.rotation.conjugate();
  const double tilt = std::acos(std::min(1.0, (turned * Eigen::Vector3d::UnitZ()).z()));
  double path = 0.0;
  for (std::size_t i = loop.from; i < loop.to; ++i) {
    path +=
        (keyframes_[i + 1].T_world_camera.translation - keyframes_[i].T_world_camera.translation)
            .norm();
  }
  return tilt < kMaxTilt && std::abs(so3::yaw(turned)) < kMaxHeading &&
         std::abs(offset.z()) < kMaxVertical_m &&
         offset.head<2>().norm() < kMaxHorizontal_m + kMaxPathFraction * path;
}

std::vector<SE3> LoopCloser::node_poses() const {
  std::vector<SE3> poses;
  for (const std::size_t i : nodes_) poses.push_back(keyframes_[i].T_world_camera);
  return poses;
}

// Expressed between the nodes nearest to its keyframes; odometry drift over that interval is
// negligible.
Edge LoopCloser::edge(const Loop& loop) const {
  const std::size_t from = nearest_node(loop.from);
  const std::size_t to = nearest_node(loop.to);
  const auto odometry = [this](std::size_t a, std::size_t b) {
    return keyframes_[a].T_world_camera.inverse() * keyframes_[b].T_world_camera;
  };
  return {.from = from,
          .to = to,
          .T_from_to =
              odometry(nodes_[from], loop.from) * loop.T_from_to * odometry(loop.to, nodes_[to]),
          .sigmas = kLoopSigmas,
          .is_loop = true};
}

Edge LoopCloser::edge_to_next(std::size_t node) const {
  const Keyframe& a = keyframes_[nodes_[node]];
  const Keyframe& b = keyframes_[nodes_[node + 1]];
  const double root = std::sqrt(seconds_between(a.stamp, b.stamp));
  return {.from = node,
          .to = node + 1,
          .T_from_to = a.T_world_camera.inverse() * b.T_world_camera,
          .sigmas = {.heading_rad = root * kRadiansPerDegree * options_.drift_deg_sqrt_s,
                     .horizontal_m = root * options_.drift_m_sqrt_s,
                     .vertical_m = root * kVerticalDriftRatio * options_.drift_m_sqrt_s}};
}

// Searches for loops with earlier places. Returns true if a loop adds information.
bool LoopCloser::detect_loops(const Place& place) {
  bool has_new = false;
  const std::vector<SE3> poses = node_poses();
  for (const Candidate& candidate : candidates()) {
    const auto place_match = recognize_place(
        candidate.stored->place, place, options_.pixel_sigma / camera_.fx, options_.min_inliers);
    if (!place_match) continue;
    const Loop loop{candidate.stored->keyframe, keyframes_.size() - 1,
                    place_match->T_now_then.inverse()};
    const bool plausible = is_plausible(loop);
    const double error_sigmas = residual_norm(edge(loop), poses, corrections_);
    log::debug(
        "loop: keyframe {} matches {}, {:.1f} s ago: {} of {} points are inliers, {:.1f} sigmas "
        "off{}",
        keyframes_.back().stamp.ns, keyframes_[loop.from].stamp.ns, age_s(loop.from),
        place_match->inliers, place_match->matches, error_sigmas,
        plausible ? "" : ": rejected as implausible");
    if (!plausible) continue;
    has_new = has_new || error_sigmas > kKnownLoopSigmas;
    loops_.push_back(loop);
  }
  return has_new;
}

// Limits the rate of optimizations, as each one changes the map.
bool LoopCloser::is_optimization_due() const {
  return !last_optimization_ ||
         seconds_between(*last_optimization_, keyframes_.back().stamp) >= kOptimizationPeriod_s;
}

void LoopCloser::optimize_graph() {
  last_optimization_ = keyframes_.back().stamp;
  has_new_loops_ = false;
  std::vector<Edge> edges;
  for (std::size_t node = 0; node + 1 < nodes_.size(); ++node) edges.push_back(edge_to_next(node));
  for (const Loop& loop : loops_) edges.push_back(edge(loop));
  optimize_pose_graph(node_poses(), edges, corrections_);
}

std::vector<KeyframeCorrection> LoopCloser::keyframe_corrections() {
  std::vector<KeyframeCorrection> all;
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    Keyframe& keyframe = keyframes_[i];
    const DriftCorrection now = correction(i);
    const SE3 before = keyframe.reported.transform() * keyframe.T_world_camera;
    const SE3 T_after_before = now.transform() * keyframe.reported.transform().inverse();
    const double moved = (T_after_before * before.translation - before.translation).norm();
    const double turned = std::abs(now.heading - keyframe.reported.heading);
    const bool newest = i + 1 == keyframes_.size();
    if (moved < kMinReportedShift_m && turned < kMinReportedTurn && !newest) continue;
    keyframe.reported = now;
    all.push_back({keyframe.stamp, T_after_before});
  }
  return all;
}

Place LoopCloser::make_place(const cv::Mat& gray) {
  Place place = describe_place(gray, camera_, options_.max_features);
  if (places_.empty()) return place;
  StoredPlace& last = places_.back();
  const SE3 T_last_now =
      keyframes_[last.keyframe].T_world_camera.inverse() * keyframes_.back().T_world_camera;
  const double sigma = options_.pixel_sigma / camera_.fx;
  triangulate_points(place, last.place, T_last_now, sigma);
  triangulate_points(last.place, place, T_last_now.inverse(), sigma);
  return place;
}

void LoopCloser::store_place(Place place) {
  places_.push_back({keyframes_.size() - 1, std::move(place)});
  if (places_.size() <= static_cast<std::size_t>(options_.max_places)) return;
  for (std::size_t k = 1; 2 * k < places_.size(); ++k) places_[k] = std::move(places_[2 * k]);
  places_.resize((places_.size() + 1) / 2);
}

std::vector<KeyframeCorrection> LoopCloser::add(Stamp stamp, const cv::Mat& gray,
                                                const SE3& T_world_camera) {
  if (!keyframes_.empty() && stamp <= keyframes_.back().stamp) return {};
  add_keyframe(stamp, T_world_camera);
  if (gray.empty() || !is_new_place()) return {};
  Place place = make_place(gray);
  const bool has_new = detect_loops(place);
  store_place(std::move(place));
  has_new_loops_ = has_new_loops_ || has_new;
  return is_optimization_due() ? flush() : std::vector<KeyframeCorrection>{};
}

std::vector<KeyframeCorrection> LoopCloser::flush() {
  if (!has_new_loops_) return {};
  optimize_graph();
  return keyframe_corrections();
}

}  // namespace apvi::loop_closure
