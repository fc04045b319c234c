// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/vio/initializer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "vio/closed_form_start.hpp"
#include "vio/gyro_bias_from_rays.hpp"
#include "vio/start_problem.hpp"
#include "vio/start_refinement.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector3d;

constexpr double kMinInliers = 0.5;     // of all sightings
constexpr double kMaxBiasSigmas = 3.0;  // of the prior, for the accelerometer bias

InitResult refuse(InitStatus status, std::string detail) {
  InitResult result;
  result.status = status;
  result.detail = std::move(detail);
  return result;
}

// The oldest frame from which on the samples are without a gap and the span is not too long.
std::size_t oldest_usable(const std::vector<InitFrame>& frames, double max_window_s) {
  std::size_t first = frames.size() - 1;
  const Stamp newest = frames.back().tracked.stamp;
  while (first > 0 && frames[first].imu.size() >= 2 &&
         seconds_between(frames[first - 1].tracked.stamp, newest) <= max_window_s) {
    --first;
  }
  return first;
}

// Median angle between the directions of the tracks that both keyframes see, the rotation taken
// out, in pixels; zero without any.
double parallax_px(const StartProblem& problem, const std::vector<imu::Preintegration>& motion,
                   int keyframe, double focal_px) {
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
  if (angles.empty()) return 0.0;
  const auto middle = angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2);
  std::nth_element(angles.begin(), middle, angles.end());
  return *middle * focal_px;
}

double largest_parallax_px(const StartProblem& problem, const Vector3d& gyro_bias,
                           double focal_px) {
  std::vector<imu::Preintegration> motion;
  imu::Preintegration now(problem.noise, gyro_bias, Vector3d::Zero());
  double largest = 0.0;
  for (int k = 0; k < problem.keyframes(); ++k) {
    const auto& samples = problem.imu[static_cast<std::size_t>(k)];
    for (std::size_t i = 1; i < samples.size(); ++i) now.integrate(samples[i - 1], samples[i]);
    motion.push_back(now);
    largest = std::max(largest, parallax_px(problem, motion, k, focal_px));
  }
  return largest;
}

// The state after the span of samples.
imu::NavState carry(const imu::NavState& from, const std::vector<ImuSample>& samples,
                    const imu::World& world) {
  imu::NavState x = from;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const ImuSample& a = samples[i - 1];
    const ImuSample& b = samples[i];
    x = imu::propagate(x, 0.5 * (a.gyro + b.gyro), 0.5 * (a.accel + b.accel),
                       seconds_between(a.stamp, b.stamp), world);
  }
  return x;
}

// All frames from the first on, in a world with z along gravity and the first frame's yaw zero.
std::vector<imu::NavState> make_states(const std::vector<InitFrame>& frames, std::size_t first,
                                       const StartGuess& guess, double gravity) {
  const imu::World world{.gravity = Vector3d(0.0, 0.0, -gravity), .earth_rate = Vector3d::Zero()};
  imu::NavState x;
  x.R_world_body = so3::level_attitude(-guess.gravity, world.gravity);
  x.v_body = guess.velocity;
  x.gyro_bias = guess.gyro_bias;
  x.accel_bias = guess.accel_bias;
  std::vector<imu::NavState> states{x};
  for (std::size_t i = first + 1; i < frames.size(); ++i) {
    states.push_back(carry(states.back(), frames[i].imu, world));
  }
  return states;
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
      return "ill conditioned";
    case InitStatus::gravity_wrong:
      return "gravity wrong";
    case InitStatus::reprojection_too_large:
      return "reprojection too large";
    case InitStatus::scale_uncertain:
      return "scale uncertain";
  }
  return "unknown";
}

InitResult initialize(const std::vector<InitFrame>& frames, const SE3& T_body_camera,
                      const imu::Noise& noise, double gravity_magnitude, const InitConfig& config) {
  const auto min_frames = static_cast<std::size_t>(config.min_frames);
  if (frames.size() < min_frames) {
    return refuse(InitStatus::too_few_frames, fmt::format("{} frames", frames.size()));
  }
  std::size_t first = oldest_usable(frames, config.max_window_s);
  if (frames.size() - first < min_frames) {
    return refuse(InitStatus::too_few_frames, "inertial samples are missing");
  }
  int common = 0;
  for (; frames.size() - first >= min_frames; ++first) {
    common = common_tracks(frames[first].tracked, frames.back().tracked);
    if (common >= config.min_tracks) break;
  }
  if (common < config.min_tracks) {
    return refuse(InitStatus::too_few_tracks, fmt::format("{} tracks in common", common));
  }
  StartProblem problem = make_start_problem(frames, first, config.keyframes);
  problem.T_body_camera = T_body_camera;
  problem.noise = noise;
  problem.gravity = gravity_magnitude;
  const StartSigmas sigmas{.gyro_bias = config.gyro_bias_sigma,
                           .accel_bias = config.accel_bias_sigma,
                           .pixel = config.pixel_sigma,
                           .focal_px = config.focal_px};
  const GyroBias gyro = find_gyro_bias(problem, sigmas);
  const double parallax = largest_parallax_px(problem, gyro.bias, config.focal_px);
  if (parallax < config.min_parallax_px) {
    return refuse(InitStatus::too_little_parallax, fmt::format("{:.1f} px", parallax));
  }
  const auto guess = closed_form_start(problem, gyro.bias, gyro.belief, sigmas);
  if (!guess) return refuse(InitStatus::ill_conditioned, "");
  const RefinedStart start = refine_start(problem, *guess, sigmas);
  if (start.inlier_share < kMinInliers || start.rms_px > config.max_reprojection_px) {
    return refuse(InitStatus::reprojection_too_large,
                  fmt::format("{:.2f} px, {:.0f} % fit", start.rms_px, 100.0 * start.inlier_share));
  }
  const double scale_sigma = relative_scale_sigma(start);
  if (!(scale_sigma < config.max_scale_sigma)) {
    return refuse(InitStatus::scale_uncertain, fmt::format("{:.1f} %", 100.0 * scale_sigma));
  }
  if (start.guess.accel_bias.norm() > kMaxBiasSigmas * config.accel_bias_sigma) {
    return refuse(InitStatus::gravity_wrong,
                  fmt::format("accelerometer bias {:.2f} m/s²", start.guess.accel_bias.norm()));
  }
  InitResult result;
  result.status = InitStatus::success;
  result.first = first;
  result.states = make_states(frames, first, start.guess, gravity_magnitude);
  result.reprojection_rms_px = start.rms_px;
  result.scale_sigma = scale_sigma;
  result.detail = fmt::format("scale known to {:.1f} %", 100.0 * scale_sigma);
  return result;
}

}  // namespace apvi::vio
