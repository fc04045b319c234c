// SPDX-License-Identifier: BSD-3-Clause
#include "vio/initialization/initializer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/median.hpp"
#include "vio/initialization/closed_form_start.hpp"
#include "vio/initialization/gyro_bias_from_rays.hpp"
#include "vio/initialization/start_graph.hpp"
#include "vio/initialization/start_problem.hpp"
#include "vio/initialization/start_refinement.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector3d;

constexpr double kMinInliers = 0.5;  // minimum inlier fraction of the observations
constexpr double kMinAcceptedTracks =
    0.5;  // minimum fraction of tracks accepted by the gyro bias estimation
constexpr double kMaxBiasSigmas = 3.0;  // in sigmas of the prior
constexpr double kMaxInertialRms =
    1.0;  // in sigmas of the IMU noise; above, the camera contradicts the IMU

InitResult refuse(InitStatus status, std::string detail) {
  InitResult result;
  result.status = status;
  result.detail = std::move(detail);
  return result;
}

bool has_gap(const std::vector<InitFrame>& frames) {
  return std::any_of(frames.begin() + 1, frames.end(),
                     [](const InitFrame& frame) { return frame.imu.size() < 2; });
}

// Median parallax [rad] of the tracks common to the first and the given keyframe, with the rotation
// removed; zero without any.
double parallax(const StartProblem& problem, const std::vector<imu::Preintegration>& motion,
                int keyframe) {
  const auto rotation = [&](int k) {
    return motion[static_cast<std::size_t>(k)].delta().rotation * problem.T_body_camera.rotation;
  };
  std::vector<double> angles;
  for (const auto& track : problem.tracks) {
    const auto& first = track.views.front();
    const auto seen = std::find_if(track.views.begin(), track.views.end(),
                                   [&](const auto& view) { return view.keyframe == keyframe; });
    if (first.keyframe != 0 || seen == track.views.end()) continue;
    const Vector3d a = rotation(0) * first.point.homogeneous().normalized();
    const Vector3d b = rotation(keyframe) * seen->point.homogeneous().normalized();
    angles.push_back(std::atan2(a.cross(b).norm(), a.dot(b)));
  }
  return median(std::move(angles));
}

double largest_parallax(const StartProblem& problem, const Vector3d& gyro_bias) {
  std::vector<imu::Preintegration> motion;
  imu::Preintegration now(problem.noise, gyro_bias, Vector3d::Zero());
  double largest = 0.0;
  for (int k = 0; k < problem.keyframes(); ++k) {
    const auto& samples = problem.imu[static_cast<std::size_t>(k)];
    for (std::size_t i = 1; i < samples.size(); ++i) now.integrate(samples[i - 1], samples[i]);
    motion.push_back(now);
    largest = std::max(largest, parallax(problem, motion, k));
  }
  return largest;
}

// Propagates the state over the samples.
imu::NavState propagate_forward(const imu::NavState& from, const std::vector<ImuSample>& samples,
                                const imu::EarthModel& world) {
  imu::NavState x = from;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const ImuSample& a = samples[i - 1];
    const ImuSample& b = samples[i];
    x = imu::propagate(x, 0.5 * (a.gyro + b.gyro), 0.5 * (a.accel + b.accel),
                       seconds_between(a.stamp, b.stamp), world);
  }
  return x;
}

// Propagates the state backward over the samples.
imu::NavState propagate_backward(const imu::NavState& to, const std::vector<ImuSample>& samples,
                                 const imu::EarthModel& world) {
  imu::Preintegration motion({}, to.gyro_bias, to.accel_bias);
  for (std::size_t i = 1; i < samples.size(); ++i) motion.integrate(samples[i - 1], samples[i]);
  const double t = motion.duration_s();
  const auto& delta = motion.delta();
  imu::NavState x = to;
  x.R_world_body = to.R_world_body * delta.rotation.conjugate();
  const Vector3d v =
      to.R_world_body * to.v_body - t * world.gravity - x.R_world_body * delta.velocity;
  x.v_body = x.R_world_body.conjugate() * v;
  x.p_world = to.p_world - t * v - 0.5 * t * t * world.gravity - x.R_world_body * delta.position;
  return x;
}

// Shifts and rotates all states about the vertical so that the first has zero yaw and position.
void start_from_zero(std::vector<imu::NavState>& states) {
  const Vector3d origin = states.front().p_world;
  const Eigen::Quaterniond turn =
      so3::exp(Vector3d(0.0, 0.0, -so3::yaw(states.front().R_world_body)));
  for (imu::NavState& x : states) {
    x.R_world_body = (turn * x.R_world_body).normalized();
    x.p_world = turn * (x.p_world - origin);
  }
}

// States of all frames: those between keyframes are propagated from the previous frame, those
// before the first keyframe from the next frame.
std::vector<imu::NavState> make_states(const std::vector<InitFrame>& frames,
                                       const StartProblem& problem, const SolvedStart& start) {
  const imu::EarthModel world{.gravity = Vector3d(0.0, 0.0, -problem.gravity),
                              .earth_rate = Vector3d::Zero()};
  std::vector<imu::NavState> states(frames.size());
  const std::size_t first = problem.frames.front();
  for (std::size_t i = first; i < frames.size(); ++i) {
    if (i > first) states[i] = propagate_forward(states[i - 1], frames[i].imu, world);
    const auto keyframe = std::find(problem.frames.begin(), problem.frames.end(), i);
    if (keyframe == problem.frames.end()) continue;
    states[i] =
        to_nav_state(start.states[static_cast<std::size_t>(keyframe - problem.frames.begin())]);
  }
  for (std::size_t i = first; i > 0; --i) {
    states[i - 1] = propagate_backward(states[i], frames[i].imu, world);
  }
  start_from_zero(states);
  return states;
}

// The longest span of frames up to the newest with enough common tracks.
struct Span {
  std::size_t first = 0;
  int common = 0;
};

Span choose_span(const std::vector<InitFrame>& frames, const InitConfig& config) {
  Span span;
  const TrackedFrame& newest = frames.back().tracked;
  for (; span.first + 1 < frames.size(); ++span.first) {
    const TrackedFrame& oldest = frames[span.first].tracked;
    if (seconds_between(oldest.stamp, newest.stamp) > config.max_window_s) continue;
    span.common = std::max(span.common, common_tracks(oldest, newest));
    if (common_tracks(oldest, newest) >= config.min_tracks) break;
  }
  return span;
}

// Acceptance test of the solution; nullopt if accepted.
std::optional<InitResult> check_solution(const SolvedStart& solved, double span_s,
                                         const InitConfig& config) {
  if (!solved.usable) return refuse(InitStatus::ill_conditioned, "no solution");
  // Over short spans sigma is less reliable, so the limit is tighter; the window refines the scale
  // later.
  if (!(solved.scale_sigma < config.max_scale_sigma * std::clamp(span_s, 1.0, 2.0))) {
    return refuse(InitStatus::scale_uncertain, fmt::format("{:.1f} %", 100.0 * solved.scale_sigma));
  }
  if (!solved.scale_is_observable) {
    return refuse(InitStatus::scale_uncertain, "scale not observable");
  }
  if (solved.inlier_fraction < kMinInliers ||
      solved.reprojection_rms_px > config.max_reprojection_px) {
    return refuse(InitStatus::reprojection_too_large,
                  fmt::format("{:.2f} px, {:.0f} % fit", solved.reprojection_rms_px,
                              100.0 * solved.inlier_fraction));
  }
  const double accel_bias = to_nav_state(solved.states.front()).accel_bias.norm();
  if (accel_bias > kMaxBiasSigmas * config.accel_bias_sigma) {
    return refuse(InitStatus::gravity_wrong,
                  fmt::format("accelerometer bias {:.2f} m/s²", accel_bias));
  }
  if (solved.inertial_rms > kMaxInertialRms) {
    return refuse(InitStatus::gravity_wrong,
                  fmt::format("inertial terms {:.1f} sigma", solved.inertial_rms));
  }
  return std::nullopt;
}

InitResult solve(const std::vector<InitFrame>& frames, const StartProblem& problem, double focal_px,
                 const InitConfig& config) {
  const StartSigmas sigmas{.gyro_bias = config.gyro_bias_sigma,
                           .accel_bias = config.accel_bias_sigma,
                           .pixel = config.pixel_sigma,
                           .focal_px = focal_px};
  const GyroBias gyro = find_gyro_bias(problem, sigmas);
  const auto accepted = std::count_if(gyro.track_weights.begin(), gyro.track_weights.end(),
                                      [](double track_weights) { return track_weights > 0.5; });
  if (static_cast<double>(accepted) <
      kMinAcceptedTracks * static_cast<double>(problem.tracks.size())) {
    return refuse(InitStatus::gyro_bias_not_found, fmt::format("{} inlier tracks", accepted));
  }
  const double parallax_deg = largest_parallax(problem, gyro.bias) / kRadiansPerDegree;
  if (parallax_deg < config.min_parallax_deg) {
    return refuse(InitStatus::too_little_parallax, fmt::format("{:.2f} deg", parallax_deg));
  }
  const auto guess = closed_form_start(problem, gyro.bias, gyro.track_weights, sigmas);
  if (!guess) return refuse(InitStatus::ill_conditioned, "closed-form solution");
  const RefinedStart refined = refine_start(problem, *guess, sigmas);
  if (refined.motion.empty())
    return refuse(InitStatus::ill_conditioned, "no point in front of the camera");
  const SolvedStart solved = solve_start(problem, refined, sigmas);
  const double span_s = seconds_between(frames[problem.frames.front()].tracked.stamp,
                                        frames[problem.frames.back()].tracked.stamp);
  if (auto reason = check_solution(solved, span_s, config)) return *reason;
  return {.status = InitStatus::success,
          .first = problem.frames.front(),
          .states = make_states(frames, problem, solved),
          .reprojection_rms_px = solved.reprojection_rms_px,
          .scale_sigma = solved.scale_sigma,
          .detail = fmt::format("scale known to {:.1f} %", 100.0 * solved.scale_sigma)};
}

}  // namespace

std::string_view to_string(InitStatus status) {
  switch (status) {
    case InitStatus::success:
      return "success";
    case InitStatus::too_few_frames:
      return "too few frames";
    case InitStatus::too_few_tracks:
      return "too few tracks";
    case InitStatus::too_little_parallax:
      return "too little parallax";
    case InitStatus::gyro_bias_not_found:
      return "gyro bias not found";
    case InitStatus::ill_conditioned:
      return "ill-conditioned";
    case InitStatus::gravity_wrong:
      return "gravity inconsistent";
    case InitStatus::reprojection_too_large:
      return "reprojection too large";
    case InitStatus::scale_uncertain:
      return "scale uncertain";
  }
  return "unknown";
}

InitResult initialize(const std::vector<InitFrame>& frames, const InitCamera& camera,
                      const imu::Noise& noise, double gravity_magnitude, const InitConfig& config) {
  const auto min_frames = static_cast<std::size_t>(config.min_frames);
  if (frames.size() < min_frames) {
    return refuse(InitStatus::too_few_frames, fmt::format("{} frames", frames.size()));
  }
  if (has_gap(frames)) return refuse(InitStatus::too_few_frames, "inertial samples are missing");
  const Stamp newest = frames.back().tracked.stamp;
  if (seconds_between(frames.front().tracked.stamp, newest) < config.min_window_s) {
    return refuse(InitStatus::too_few_frames, "span too short");
  }
  const Span span = choose_span(frames, config);
  if (frames.size() - span.first < min_frames ||
      seconds_between(frames[span.first].tracked.stamp, newest) < config.min_window_s) {
    return refuse(InitStatus::too_few_tracks, fmt::format("{} common tracks", span.common));
  }
  StartProblem problem = make_start_problem(frames, span.first, config.keyframes);
  problem.T_body_camera = camera.T_body_camera;
  problem.noise = noise;
  problem.gravity = gravity_magnitude;
  return solve(frames, problem, camera.focal_px, config);
}

}  // namespace apvi::vio
