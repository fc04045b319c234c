// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/loop/loop_closer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/angles.hpp"
#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::loop {
namespace {

// From one place to the next, so that they tell each other distances.
constexpr double kLeastStep_m = 0.25;
constexpr double kLeastTurn = 10.0 * kRadians;
constexpr double kLeastWait_s = 0.5;

constexpr std::size_t kCandidates = 3;
constexpr double kLeastShown = 0.3;            // of a place's points, in the picture
constexpr double kMostTurn = 50.0 * kRadians;  // SIFT knows little again beyond
constexpr double kMostNearer = 2.0;            // or farther, as a factor

const EdgeSigmas kLoopSigmas{
    .heading_rad = 0.05 * kRadians, .horizontal_m = 0.007, .vertical_m = 0.007};
constexpr double kVertical = 0.25;  // of horizontal drift: pressure knows
constexpr double kFits = 2.0;       // sigmas: a loop that says nothing new
constexpr double kBendStep_s = 4.0;
constexpr double kNodeStep_s = 4.0;  // half of the least age of a loop, at most

// What no odometry with a DVL drifts by; beyond it is another place that looks alike.
constexpr double kMostTilt = 3.0 * kRadians;
constexpr double kMostHeading = 20.0 * kRadians;
constexpr double kMostVertical_m = 0.5;
constexpr double kMostHorizontal_m = 0.5;
constexpr double kMostOfPath = 0.05;

// What is told: less moves no pixel.
constexpr double kLeastMove_m = 1e-3;
constexpr double kLeastTurned = 2e-4;

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
      {stamp, T_world_camera, keyframes_.empty() ? Correction{} : keyframes_.back().told});
  if (!nodes_.empty() && age_s(nodes_.back()) < kNodeStep_s) return;
  nodes_.push_back(index);
  corrections_.push_back(corrections_.empty() ? Correction{} : corrections_.back());
}

void LoopCloser::move(Stamp stamp, const SE3& T_world_camera) {
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

// Linear from node to node, so that what single loops are off by cannot bend the way from one
// keyframe to the next.
Correction LoopCloser::correction(std::size_t keyframe) const {
  const auto next = std::upper_bound(nodes_.begin(), nodes_.end(), keyframe);
  const auto before = static_cast<std::size_t>(next - nodes_.begin()) - 1;
  const Correction& a = corrections_[before];
  if (next == nodes_.end()) return a;
  const Correction& b = corrections_[before + 1];
  const Stamp begin = keyframes_[nodes_[before]].stamp;
  const double part = seconds_between(begin, keyframes_[keyframe].stamp) /
                      seconds_between(begin, keyframes_[*next].stamp);
  return {.heading = a.heading + part * (b.heading - a.heading),
          .translation = a.translation + part * (b.translation - a.translation)};
}

SE3 LoopCloser::corrected(std::size_t keyframe) const {
  return correction(keyframe).motion() * keyframes_[keyframe].T_world_camera;
}

bool LoopCloser::is_elsewhere() const {
  if (places_.empty()) return true;
  const std::size_t last = places_.back().keyframe;
  if (age_s(last) < kLeastWait_s) return false;
  const SE3& here = keyframes_.back().T_world_camera;
  const SE3& there = keyframes_[last].T_world_camera;
  return (here.translation - there.translation).norm() > kLeastStep_m ||
         so3::angle_between(here.rotation, there.rotation) > kLeastTurn;
}

// Share of a place's points that would be in the picture, and not much nearer or farther.
double LoopCloser::shown(const Kept& kept, const SE3& T_camera_world) const {
  const SE3 T_now_then = T_camera_world * corrected(kept.keyframe);
  if ((T_now_then.rotation * Eigen::Vector3d::UnitZ()).z() < std::cos(kMostTurn)) return 0.0;
  std::size_t in_picture = 0;
  for (const auto& point : kept.place.points) {
    if (!point) continue;
    const Eigen::Vector3d p = T_now_then * *point;
    if (p.z() * kMostNearer < point->z() || p.z() > kMostNearer * point->z()) continue;
    const double u = camera_.fx * p.x() / p.z() + camera_.cx;
    const double v = camera_.fy * p.y() / p.z() + camera_.cy;
    if (u > 0.0 && v > 0.0 && u < camera_.width && v < camera_.height) ++in_picture;
  }
  return static_cast<double>(in_picture) /
         static_cast<double>(std::max<std::size_t>(1, kept.place.depths()));
}

std::vector<LoopCloser::Candidate> LoopCloser::candidates() const {
  const SE3 T_camera_world = corrected(keyframes_.size() - 1).inverse();
  std::vector<Candidate> found;
  for (const Kept& kept : places_) {
    if (age_s(kept.keyframe) < options_.least_age_s) break;
    if (kept.place.depths() < static_cast<std::size_t>(options_.least_inliers)) continue;
    const double share = shown(kept, T_camera_world);
    if (share > kLeastShown) found.push_back({&kept, share});
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Candidate& a, const Candidate& b) { return a.shown > b.shown; });
  found.resize(std::min(found.size(), kCandidates));
  return found;
}

bool LoopCloser::is_likely(const Loop& loop) const {
  const SE3 believed = corrected(loop.to);
  const SE3 found = corrected(loop.from) * loop.T_from_to;
  const Eigen::Vector3d off = found.translation - believed.translation;
  const Eigen::Quaterniond turned = found.rotation * believed.rotation.conjugate();
  const double tilt = std::acos(std::min(1.0, (turned * Eigen::Vector3d::UnitZ()).z()));
  double path = 0.0;
  for (std::size_t i = loop.from; i < loop.to; ++i) {
    path +=
        (keyframes_[i + 1].T_world_camera.translation - keyframes_[i].T_world_camera.translation)
            .norm();
  }
  return tilt < kMostTilt && std::abs(so3::yaw(turned)) < kMostHeading &&
         std::abs(off.z()) < kMostVertical_m &&
         off.head<2>().norm() < kMostHorizontal_m + kMostOfPath * path;
}

std::vector<SE3> LoopCloser::node_poses() const {
  std::vector<SE3> poses;
  for (const std::size_t i : nodes_) poses.push_back(keyframes_[i].T_world_camera);
  return poses;
}

// Between the nodes next to its keyframes: over so short a time odometry knows.
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
          .may_be_wrong = true};
}

Edge LoopCloser::edge_to_next(std::size_t node) const {
  const Keyframe& a = keyframes_[nodes_[node]];
  const Keyframe& b = keyframes_[nodes_[node + 1]];
  const double root = std::sqrt(seconds_between(a.stamp, b.stamp));
  return {.from = node,
          .to = node + 1,
          .T_from_to = a.T_world_camera.inverse() * b.T_world_camera,
          .sigmas = {.heading_rad = root * kRadians * options_.drift_deg,
                     .horizontal_m = root * options_.drift_m,
                     .vertical_m = root * kVertical * options_.drift_m}};
}

// Whether something is known that was not.
bool LoopCloser::close(const Place& place) {
  bool news = false;
  const std::vector<SE3> poses = node_poses();
  for (const Candidate& candidate : candidates()) {
    const auto sighting = recognise(candidate.kept->place, place, options_.pixel_sigma / camera_.fx,
                                    options_.least_inliers);
    if (!sighting) continue;
    const Loop loop{candidate.kept->keyframe, keyframes_.size() - 1,
                    sighting->T_now_then.inverse()};
    const bool likely = is_likely(loop);
    const double off = misfit(edge(loop), poses, corrections_);
    log::debug("loop: {} is where {} was, {:.1f} s ago: {} of {} points agree, {:.1f} sigmas off{}",
               keyframes_.back().stamp.ns, keyframes_[loop.from].stamp.ns, age_s(loop.from),
               sighting->inliers, sighting->matches, off, likely ? "" : ": not believed");
    if (!likely) continue;
    news = news || off > kFits;
    loops_.push_back(loop);
  }
  return news;
}

// The map pays for every bend.
bool LoopCloser::is_due() const {
  return !bent_ || seconds_between(*bent_, keyframes_.back().stamp) >= kBendStep_s;
}

void LoopCloser::bend() {
  bent_ = keyframes_.back().stamp;
  has_news_ = false;
  std::vector<Edge> edges;
  for (std::size_t node = 0; node + 1 < nodes_.size(); ++node) edges.push_back(edge_to_next(node));
  for (const Loop& loop : loops_) edges.push_back(edge(loop));
  optimise(node_poses(), edges, corrections_);
}

std::vector<Relocation> LoopCloser::relocations() {
  std::vector<Relocation> all;
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    Keyframe& keyframe = keyframes_[i];
    const Correction now = correction(i);
    const SE3 before = keyframe.told.motion() * keyframe.T_world_camera;
    const SE3 T_after_before = now.motion() * keyframe.told.motion().inverse();
    const double moved = (T_after_before * before.translation - before.translation).norm();
    const double turned = std::abs(now.heading - keyframe.told.heading);
    const bool newest = i + 1 == keyframes_.size();
    if (moved < kLeastMove_m && turned < kLeastTurned && !newest) continue;
    keyframe.told = now;
    all.push_back({keyframe.stamp, T_after_before});
  }
  return all;
}

Place LoopCloser::make_place(const cv::Mat& grey) {
  Place place = describe(grey, camera_, options_.features);
  if (places_.empty()) return place;
  Kept& last = places_.back();
  const SE3 T_last_now =
      keyframes_[last.keyframe].T_world_camera.inverse() * keyframes_.back().T_world_camera;
  const double sigma = options_.pixel_sigma / camera_.fx;
  give_depth(place, last.place, T_last_now, sigma);
  give_depth(last.place, place, T_last_now.inverse(), sigma);
  return place;
}

void LoopCloser::keep(Place place) {
  places_.push_back({keyframes_.size() - 1, std::move(place)});
  if (places_.size() <= static_cast<std::size_t>(options_.places)) return;
  for (std::size_t k = 1; 2 * k < places_.size(); ++k) places_[k] = std::move(places_[2 * k]);
  places_.resize((places_.size() + 1) / 2);
}

std::vector<Relocation> LoopCloser::add(Stamp stamp, const cv::Mat& grey,
                                        const SE3& T_world_camera) {
  if (!keyframes_.empty() && stamp <= keyframes_.back().stamp) return {};
  add_keyframe(stamp, T_world_camera);
  if (grey.empty() || !is_elsewhere()) return {};
  Place place = make_place(grey);
  const bool news = close(place);
  keep(std::move(place));
  has_news_ = has_news_ || news;
  return is_due() ? settle() : std::vector<Relocation>{};
}

std::vector<Relocation> LoopCloser::settle() {
  if (!has_news_) return {};
  bend();
  return relocations();
}

}  // namespace apvi::loop
