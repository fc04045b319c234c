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

constexpr std::size_t kMinFrames = 4;
constexpr double kMinInliers = 0.6;  // minimum share of landmarks that fit

// Another motion is ruled out when its squared error is so many times that of the best.
constexpr double kClearly = 1.5;
// StartSolutions that differ by less are the same [rad].
constexpr double kSameDirection = 0.1;
constexpr double kSameRotation = 0.01;

bool are_alike(const SE3& a, const SE3& b) {
  const double angle =
      std::acos(std::clamp(a.translation.normalized().dot(b.translation.normalized()), -1.0, 1.0));
  return angle < kSameDirection && so3::angle_between(a.rotation, b.rotation) < kSameRotation;
}

// The solution with the smallest error, unless another one is almost as good: on a flat scene with
// little parallax, two motions explain the images.
std::optional<Window> clear_best(std::vector<StartSolution>& solutions, std::string& waiting_for) {
  const auto by_cost = [](const StartSolution& a, const StartSolution& b) {
    return a.fit.cost < b.fit.cost;
  };
  const auto best = std::ranges::min_element(solutions, by_cost);
  if (best == solutions.end() || best->fit.inliers < kMinInliers) {
    waiting_for = "images that agree on the motion of the camera";
    return std::nullopt;
  }
  for (const StartSolution& other : solutions) {
    if (other.fit.cost >= kClearly * best->fit.cost) continue;
    if (are_alike(other.motion(), best->motion())) continue;
    waiting_for = "parallax that tells two possible motions apart";
    return std::nullopt;
  }
  return std::move(best->window);
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

PointsById landmark_positions(const Window& window) {
  PointsById points;
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.triangulated()) points[id] = position(landmark, window);
  }
  return points;
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
  const StartAttempt attempt(frames, base, config, rig);
  const std::vector<SE3> motions = possible_motions(matches.pairs, attempt.max_error());
  double parallax = 0.0;
  for (const SE3& motion : motions)
    parallax = std::max(parallax, median_parallax(matches.pairs, motion));
  if (parallax < config.visual.min_parallax_deg * kRadiansPerDegree) {
    waiting_for = fmt::format("parallax (now {:.1f} deg)", parallax / kRadiansPerDegree);
    return std::nullopt;
  }
  std::vector<StartSolution> solutions;
  for (const SE3& motion : motions) {
    if (auto solution = attempt.solve(motion, matches)) solutions.push_back(*std::move(solution));
  }
  std::optional<Window> best = clear_best(solutions, waiting_for);
  if (!best) return std::nullopt;
  remove_rejected(*best);
  const double depth = median_depth(*best);
  scale_lengths(*best, config.visual.start_distance / depth);
  VisualStart start{.window = *std::move(best), .T_world_body = {}};
  start.T_world_body =
      locate(frames, start.window, rig.cameras.front().T_body_camera, attempt.max_error(),
             static_cast<std::size_t>(config.visual.min_tracks) / 2);
  return start;
}

}  // namespace apvi::vio
