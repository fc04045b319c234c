// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/visual_start.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "vio/initialization/start_problem.hpp"
#include "vio/visual/two_view.hpp"
#include "vio/window/graph.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

using Frames = std::vector<const TrackedFrame*>;

constexpr int kRounds = 2;  // solve, reject outliers, triangulate the rest, solve again
constexpr int kIterations = 20;
constexpr std::size_t kMinFrames = 4;
constexpr double kMinInliers = 0.6;  // minimum share of landmarks that fit

// Another motion is ruled out when its squared error is so many times that of the best.
constexpr double kClearly = 1.5;
// Solutions that differ by less are the same [rad].
constexpr double kSameDirection = 0.1;
constexpr double kSameRotation = 0.01;

struct Matches {
  std::vector<std::int64_t> ids;
  std::vector<PointPair> pairs;
};

Matches match(const TrackedFrame& first, const TrackedFrame& second) {
  Matches found;
  auto it = second.observations.begin();
  const auto end = second.observations.end();
  for (const FeatureObservation& seen : first.observations) {
    if (seen.camera != 0) break;
    while (it != end && it->camera == 0 && it->id < seen.id) ++it;
    if (it == end || it->camera != 0) break;
    if (it->id != seen.id) continue;
    found.ids.push_back(seen.id);
    found.pairs.push_back({seen.point, it->point});
  }
  return found;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Points in the first camera, scaled so that their median depth is `distance`; `motion` is scaled
// with them.
PointsById triangulate_all(const Matches& matches, double distance, SE3& motion) {
  PointsById points;
  std::vector<double> depths;
  for (std::size_t i = 0; i < matches.ids.size(); ++i) {
    const auto point = triangulate(matches.pairs[i], motion);
    if (!point) continue;
    depths.push_back(point->depth);
    points[matches.ids[i]] = point->depth * matches.pairs[i].before.homogeneous();
  }
  if (points.empty()) return points;
  const double scale = distance / median(std::move(depths));
  for (auto& [id, point] : points) point *= scale;
  motion.translation *= scale;
  return points;
}

void add_frame(Window& window, const TrackedFrame& tracked, const SE3& T_world_body) {
  auto frame = std::make_unique<Frame>();
  frame->stamp = tracked.stamp;
  frame->state.pose = to_block(T_world_body);
  window.frames.push_back(std::move(frame));
  add_observations(window, window.newest(), first_camera_of(tracked));
}

// Evenly spaced frames, including the first and the last.
Frames thin(const std::vector<TrackedFrame>& frames, std::size_t first, std::size_t count) {
  const std::size_t all = frames.size() - first;
  const std::size_t n = std::min(all, count);
  Frames chosen;
  for (std::size_t k = 0; k < n; ++k) chosen.push_back(&frames[first + k * (all - 1) / (n - 1)]);
  return chosen;
}

// Mean of squared reprojection errors, each limited [px²], and the share of landmarks that fit.
struct Fit {
  double cost = std::numeric_limits<double>::infinity();
  double inliers = 0.0;
};

Fit fit_of(const Window& window, const Rig& rig, double max_error_px) {
  double sum = 0.0;
  std::size_t count = 0;
  std::size_t landmarks = 0;
  std::size_t good = 0;
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.observations.size() < 3) continue;
    ++landmarks;
    good += landmark.triangulated() ? 1 : 0;
    for (const Landmark::Observation& seen : landmark.observations) {
      const double error = landmark.triangulated()
                               ? reprojection_error_px(landmark, seen, window, rig)
                               : max_error_px;
      sum += std::min(error * error, max_error_px * max_error_px);
      ++count;
    }
  }
  if (count == 0) return {};
  return {sum / static_cast<double>(count),
          static_cast<double>(good) / static_cast<double>(landmarks)};
}

/// A motion after bundle adjustment.
struct Solution {
  Window window;
  Fit fit;

  SE3 motion() const {
    return to_se3(window.frames.front()->state.pose.data()).inverse() *
           to_se3(window.frames.back()->state.pose.data());
  }
};

bool are_alike(const SE3& a, const SE3& b) {
  const double angle =
      std::acos(std::clamp(a.translation.normalized().dot(b.translation.normalized()), -1.0, 1.0));
  return angle < kSameDirection && so3::angle_between(a.rotation, b.rotation) < kSameRotation;
}

// The solution with the smallest error, unless another one is almost as good: on a flat scene with
// little parallax, two motions explain the images.
std::optional<Window> clear_best(std::vector<Solution>& solutions, std::string& waiting_for) {
  const auto by_cost = [](const Solution& a, const Solution& b) { return a.fit.cost < b.fit.cost; };
  const auto best = std::ranges::min_element(solutions, by_cost);
  if (best == solutions.end() || best->fit.inliers < kMinInliers) {
    waiting_for = "images that agree on the motion of the camera";
    return std::nullopt;
  }
  for (const Solution& other : solutions) {
    if (other.fit.cost >= kClearly * best->fit.cost) continue;
    if (are_alike(other.motion(), best->motion())) continue;
    waiting_for = "parallax that tells two possible motions apart";
    return std::nullopt;
  }
  return std::move(best->window);
}

/// One attempt with frames from `base` on.
class Attempt {
 public:
  Attempt(const std::vector<TrackedFrame>& frames, std::size_t base, const Config& config,
          const Rig& rig)
      : config_(config),
        rig_(rig),
        T_body_camera_(rig.cameras.front().T_body_camera),
        focal_(rig.cameras.front().model.parameters().fx),
        chosen_(thin(frames, base, static_cast<std::size_t>(config.window.keyframes))) {
    config_.vision.estimate_extrinsics = config_.vision.estimate_time_offset = false;
  }

  // Bundle adjustment from the motion between the first and the last frame.
  std::optional<Solution> solve(SE3 motion, const Matches& matches) const {
    const PointsById points = triangulate_all(matches, config_.visual.start_distance, motion);
    Window window = empty_window(rig_);
    const SE3 T_camera_body = T_body_camera_.inverse();
    const auto min_points = static_cast<std::size_t>(config_.visual.min_tracks);
    for (const TrackedFrame* frame : chosen_) {
      std::optional<SE3> camera = resect(*frame, points, max_error(), min_points / 2);
      if (frame == chosen_.front()) camera = SE3::identity();
      if (frame == chosen_.back()) camera = motion;
      if (camera) add_frame(window, *frame, T_body_camera_ * *camera * T_camera_body);
    }
    if (window.frames.size() < std::min(kMinFrames, chosen_.size())) return std::nullopt;
    window.frames.front()->frozen = true;  // the world
    adjust(window);
    window.frames.front()->frozen = false;
    const Fit fit = fit_of(window, rig_, config_.vision.max_reprojection_px);
    if (!(median_depth(window) > 0.0)) return std::nullopt;
    return Solution{std::move(window), fit};
  }

  double max_error() const { return config_.vision.max_reprojection_px / focal_; }

 private:
  void adjust(Window& window) const {
    for (int round = 0; round < kRounds; ++round) {
      triangulate(window, config_.vision.min_parallax_deg * kRadiansPerDegree);
      const Graph graph(window, config_, rig_);
      vio::solve(graph, window, config_, kIterations);
      reject_outliers(window, rig_, config_.vision.max_reprojection_px);
      if (round + 1 < kRounds) window.rejected_tracks.clear();
    }
  }

  Config config_;
  const Rig& rig_;
  SE3 T_body_camera_;
  double focal_;
  Frames chosen_;
};

void scale(Window& window, double factor) {
  const Eigen::Vector3d origin = to_se3(window.frames.front()->state.pose.data()).translation;
  for (const auto& frame : window.frames) {
    Eigen::Map<Eigen::Vector3d> position(frame->state.pose.data());
    position = origin + factor * (position - origin);
  }
  for (auto& [id, landmark] : window.landmarks) landmark.inverse_depth /= factor;
}

std::vector<std::optional<SE3>> locate(const std::vector<TrackedFrame>& frames,
                                       const Window& window, const SE3& T_body_camera,
                                       double max_error, std::size_t min_points) {
  const PointsById points = landmark_positions(window);
  std::vector<std::optional<SE3>> poses;
  for (const TrackedFrame& frame : frames) {
    const auto same = [&](const auto& kept) { return kept->stamp == frame.stamp; };
    const auto kept = std::ranges::find_if(window.frames, same);
    if (kept != window.frames.end()) {
      poses.emplace_back(to_se3((*kept)->state.pose.data()));
      continue;
    }
    const auto camera = resect(frame, points, max_error, min_points);
    poses.push_back(camera ? std::optional(*camera * T_body_camera.inverse()) : std::nullopt);
  }
  return poses;
}

// The oldest frame with enough tracks in common with the newest; the newest itself if none.
std::size_t base_of(const std::vector<TrackedFrame>& frames, int min_tracks) {
  std::size_t base = 0;
  while (base + 1 < frames.size() && common_tracks(frames[base], frames.back()) < min_tracks) {
    ++base;
  }
  return base;
}

}  // namespace

TrackedFrame first_camera_of(const TrackedFrame& frame) {
  TrackedFrame out = frame;
  std::erase_if(out.observations, [](const FeatureObservation& seen) { return seen.camera != 0; });
  return out;
}

PointsById landmark_positions(const Window& window) {
  PointsById points;
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.triangulated()) points[id] = position(landmark, window);
  }
  return points;
}

double median_depth(const Window& window) {
  std::vector<double> depths;
  for (const auto& [id, landmark] : window.landmarks) {
    if (!landmark.triangulated()) continue;
    const Landmark::Observation& last = landmark.observations.back();
    if (last.frame != &window.newest()) continue;
    depths.push_back((camera_pose(last, window).inverse() * position(landmark, window)).z());
  }
  return median(std::move(depths));
}

std::optional<VisualStart> start_visually(const std::vector<TrackedFrame>& frames,
                                          const Config& config, const Rig& rig,
                                          std::string& waiting_for) {
  const std::size_t base = base_of(frames, config.visual.min_tracks);
  if (frames.size() - base < kMinFrames) {
    waiting_for = "images with corners in common";
    return std::nullopt;
  }
  const Matches matches = match(frames[base], frames.back());
  const Attempt attempt(frames, base, config, rig);
  const std::vector<SE3> motions = possible_motions(matches.pairs, attempt.max_error());
  double parallax = 0.0;
  for (const SE3& motion : motions)
    parallax = std::max(parallax, median_parallax(matches.pairs, motion));
  if (parallax < config.visual.min_parallax_deg * kRadiansPerDegree) {
    waiting_for = fmt::format("parallax (now {:.1f} deg)", parallax / kRadiansPerDegree);
    return std::nullopt;
  }
  std::vector<Solution> solutions;
  for (const SE3& motion : motions) {
    if (auto solution = attempt.solve(motion, matches)) solutions.push_back(*std::move(solution));
  }
  std::optional<Window> best = clear_best(solutions, waiting_for);
  if (!best) return std::nullopt;
  remove_rejected(*best);
  const double depth = median_depth(*best);
  scale(*best, config.visual.start_distance / depth);
  VisualStart start{.window = *std::move(best), .T_world_body = {}};
  start.T_world_body =
      locate(frames, start.window, rig.cameras.front().T_body_camera, attempt.max_error(),
             static_cast<std::size_t>(config.visual.min_tracks) / 2);
  return start;
}

}  // namespace apvi::vio
