// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/start_attempt.hpp"

#include <algorithm>
#include <memory>
#include <utility>

#include "apvi/core/constants.hpp"
#include "core/median.hpp"
#include "vio/initialization/start_problem.hpp"
#include "vio/visual/depth_profile.hpp"
#include "vio/visual/resection.hpp"
#include "vio/visual/two_view.hpp"
#include "vio/window/graph.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

constexpr int kRounds = 2;  // solve, reject outliers, triangulate the rest, solve again
constexpr int kIterations = 20;
constexpr std::size_t kMinFrames = 4;
constexpr double kGoodShare = 0.5;   // of the largest error of a landmark that fits [squared]
constexpr double kMaxSolve_s = 1.0;  // the choice of a motion needs converged solutions

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

// Every landmark has the depth that fits best, so that far points, which are not triangulated,
// count as much as near ones.
StartFit fit_of(const Window& window, double focal, double max_error_px) {
  double sum = 0.0;
  std::size_t count = 0;
  std::size_t landmarks = 0;
  std::size_t good = 0;
  for (const auto& [id, landmark] : window.landmarks) {
    if (landmark.observations.size() < 3) continue;
    const DepthProfile profile(landmark, window, focal, max_error_px);
    const double least = profile.least(landmark.inverse_depth);
    const auto views = static_cast<double>(profile.count());
    ++landmarks;
    good += least < kGoodShare * views * max_error_px * max_error_px ? 1 : 0;
    sum += least;
    count += profile.count();
  }
  if (count == 0) return {};
  return {sum / static_cast<double>(count),
          static_cast<double>(good) / static_cast<double>(landmarks)};
}

// A second camera has a scale of its own.
TrackedFrame first_camera_of(const TrackedFrame& frame) {
  TrackedFrame out = frame;
  std::erase_if(out.observations, [](const FeatureObservation& seen) { return seen.camera != 0; });
  return out;
}

}  // namespace

Matches match(const TrackedFrame& first, const TrackedFrame& second) {
  Matches found;
  visit_common_tracks(first, second, [&](const FeatureObservation& a, const FeatureObservation& b) {
    found.ids.push_back(a.id);
    found.pairs.push_back({a.point, b.point});
  });
  return found;
}

SE3 StartSolution::motion() const {
  return to_se3(window.frames.front()->state.pose.data()).inverse() *
         to_se3(window.frames.back()->state.pose.data());
}

StartAttempt::StartAttempt(const std::vector<TrackedFrame>& frames, std::size_t base,
                           const Config& config, const Rig& rig)
    : config_(config),
      rig_(rig),
      T_body_camera_(rig.cameras.front().T_body_camera),
      focal_(rig.cameras.front().model.parameters().fx) {
  for (const std::size_t i :
       choose_keyframes(base, frames.size() - base, config.window.keyframes)) {
    chosen_.push_back(&frames[i]);
  }
  config_.calibration = CalibrationConfig::fixed();
  config_.window.max_solve_s = kMaxSolve_s;
}

std::optional<StartSolution> StartAttempt::solve(SE3 motion, const Matches& matches) const {
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
  const StartFit fit = fit_of(window, focal_, config_.vision.max_reprojection_px);
  if (!(median_depth(window) > 0.0)) return std::nullopt;
  return StartSolution{std::move(window), fit};
}

void StartAttempt::adjust(Window& window) const {
  for (int round = 0; round < kRounds; ++round) {
    triangulate(window, config_.vision.min_parallax_deg * kRadiansPerDegree);
    const Graph graph(window, config_, rig_);
    vio::solve(graph, window, config_, kIterations);
    reject_outliers(window, rig_, config_.vision.max_reprojection_px);
    if (round + 1 < kRounds) window.rejected_tracks.clear();
  }
}

void add_frame(Window& window, const TrackedFrame& tracked, const SE3& T_world_body) {
  auto frame = std::make_unique<Frame>();
  frame->stamp = frame->image_stamp = tracked.stamp;
  frame->state.pose = to_block(T_world_body);
  window.frames.push_back(std::move(frame));
  add_observations(window, window.newest(), first_camera_of(tracked));
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

}  // namespace apvi::vio
