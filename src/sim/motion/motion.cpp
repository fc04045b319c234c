// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "sim/motion/file_motion.hpp"
#include "sim/motion/path.hpp"

namespace apvi::sim {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;
// Short enough that the smoothing of the control points by the B-spline does not damp 1 Hz
// oscillations.
constexpr double kKnotPeriod_s = 0.1;
constexpr double kMaxSlope = 0.4;  // of the path, for the pitch that follows it
constexpr double kYawSmoothing_s = 0.5;
constexpr std::uint64_t kOscillationStream = 11;
constexpr std::uint64_t kWavesStream = 12;

// Band-limited noise with standard deviation 1: a sum of sinusoids around one period.
class SmoothNoise {
 public:
  SmoothNoise(Random& random, double period_s) {
    for (Tone& tone : tones_) {
      tone.frequency = 2.0 * kPi / period_s * random.uniform(0.55, 1.6);
      tone.phase = random.uniform(0.0, 2.0 * kPi);
    }
  }
  double at(double t) const {
    double sum = 0.0;
    for (const Tone& tone : tones_) sum += std::sin(tone.frequency * t + tone.phase);
    return sum * std::sqrt(2.0 / kTones);
  }

 private:
  static constexpr int kTones = 4;
  struct Tone {
    double frequency = 0.0;
    double phase = 0.0;
  };
  std::array<Tone, kTones> tones_;
};

// Planned motion at every knot, before conversion to poses. Angles in radians.
struct Plan {
  std::vector<double> t;  // since the start [s]
  std::vector<Vector3d> position;
  std::vector<double> yaw;
  std::vector<double> nose_up;
  std::vector<double> roll;

  std::size_t size() const { return t.size(); }
};

double smooth_step(double u) {
  u = std::clamp(u, 0.0, 1.0);
  return u * u * u * (10.0 + u * (-15.0 + 6.0 * u));
}

// Speed along the dense path: cruising speed, reduced where the curvature exceeds the maximum turn
// rate.
std::vector<double> speed_along(const std::vector<Vector3d>& path, const MotionConfig& config) {
  std::vector<double> speed(path.size(), config.speed_m_s);
  const double max_rate = config.max_turn_deg_s * kRadiansPerDegree;
  for (std::size_t i = 1; i + 1 < path.size(); ++i) {
    const Vector3d before = path[i] - path[i - 1];
    const Vector3d after = path[i + 1] - path[i];
    const double angle = std::atan2(before.cross(after).norm(), before.dot(after));
    const double bend = angle / (0.5 * (before.norm() + after.norm()) + 1e-9);
    speed[i] = std::clamp(max_rate / (bend + 1e-9), 0.2 * config.speed_m_s, config.speed_m_s);
  }
  constexpr double kBraking_m = 0.4;
  smooth(speed, kBraking_m / kPathStep);
  return speed;
}

Vector3d point_at(const std::vector<Vector3d>& path, const std::vector<double>& arc, double s) {
  const auto upper = std::upper_bound(arc.begin(), arc.end(), s);
  const auto i = std::clamp<std::ptrdiff_t>(upper - arc.begin(), 1,
                                            static_cast<std::ptrdiff_t>(arc.size()) - 1);
  const auto at = static_cast<std::size_t>(i);
  const double length = std::max(arc[at] - arc[at - 1], 1e-12);
  return path[at - 1] + (path[at] - path[at - 1]) * ((s - arc[at - 1]) / length);
}

// Moves along the dense path: rests, accelerates, cruises.
void follow_path(const MotionConfig& config, const std::vector<Vector3d>& path, Plan& plan) {
  std::vector<double> arc{0.0};
  for (std::size_t i = 1; i < path.size(); ++i) {
    arc.push_back(arc.back() + (path[i] - path[i - 1]).norm());
  }
  const std::vector<double> speed = speed_along(path, config);
  constexpr int kSubsteps = 10;
  constexpr double kStep = kKnotPeriod_s / kSubsteps;
  double s = 0.0;
  for (const double t : plan.t) {
    plan.position.push_back(point_at(path, arc, s));
    for (int k = 0; k < kSubsteps; ++k) {
      const auto i =
          static_cast<std::size_t>(std::lower_bound(arc.begin(), arc.end() - 1, s) - arc.begin());
      s += kStep * speed[i] * smooth_step((t + k * kStep - config.rest_s) / config.ramp_s);
    }
  }
}

double heading_along(const MotionConfig& config, const Plan& plan, std::size_t i) {
  if (config.path == PathKind::hover) return config.heading_deg * kRadiansPerDegree;
  // At rest, use the direction of the upcoming motion.
  for (std::size_t j = i + 1; j < plan.size(); ++j) {
    const Vector3d step = plan.position[j] - plan.position[i];
    if (step.head<2>().norm() > 0.02) return std::atan2(step.y(), step.x());
  }
  return i > 0 ? heading_along(config, plan, i - 1) : 0.0;
}

double target_yaw(const MotionConfig& config, const Plan& plan, std::size_t i) {
  switch (config.look) {
    case HeadingMode::fixed:
      return config.look_heading_deg * kRadiansPerDegree;
    case HeadingMode::point: {
      const Vector3d& p = plan.position[i];
      return std::atan2(config.look_at[1] - p.y(), config.look_at[0] - p.x());
    }
    case HeadingMode::left:
      return heading_along(config, plan, i) + kPi / 2.0;
    case HeadingMode::right:
      return heading_along(config, plan, i) - kPi / 2.0;
    case HeadingMode::along:
      return heading_along(config, plan, i);
  }
  return 0.0;
}

void set_heading(const MotionConfig& config, Plan& plan) {
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const double wanted = target_yaw(config, plan, i);
    const double before = i > 0 ? plan.yaw[i - 1] : wanted;
    plan.yaw.push_back(before + std::remainder(wanted - before, 2.0 * kPi));
  }
  smooth(plan.yaw, kYawSmoothing_s / kKnotPeriod_s);
}

void set_roll_and_pitch(const MotionConfig& config, const MotionContext& context, Plan& plan) {
  const AttitudeConfig& attitude = config.attitude;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const std::size_t a = i > 0 ? i - 1 : 0;
    const std::size_t b = std::min(i + 1, plan.size() - 1);
    const double span = static_cast<double>(b - a) * kKnotPeriod_s;
    const Vector3d velocity = (plan.position[b] - plan.position[a]) / span;
    const double turn = (plan.yaw[b] - plan.yaw[a]) / span;
    const double speed = velocity.head<2>().norm();
    const double slope = std::clamp(velocity.z() / std::max(speed, 0.1), -kMaxSlope, kMaxSlope);
    plan.roll.push_back(attitude.trim_roll_deg * kRadiansPerDegree -
                        attitude.bank_gain * std::atan(speed * turn / context.gravity));
    plan.nose_up.push_back(attitude.trim_pitch_deg * kRadiansPerDegree +
                           attitude.climb_gain * slope);
  }
}

void add_oscillation(const MotionConfig& config, Random random, Plan& plan) {
  const AttitudeConfig& attitude = config.attitude;
  const double period = attitude.oscillation_period_s;
  const SmoothNoise roll(random, period);
  const SmoothNoise pitch(random, 1.2 * period);
  const SmoothNoise yaw(random, 2.0 * period);
  const SmoothNoise x(random, 1.7 * period);
  const SmoothNoise y(random, 1.7 * period);
  const SmoothNoise z(random, 2.1 * period);
  const double tilt = attitude.oscillation_deg * kRadiansPerDegree;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const double t = plan.t[i];
    plan.roll[i] += tilt * roll.at(t);
    plan.nose_up[i] += 0.7 * tilt * pitch.at(t);
    plan.yaw[i] += 0.7 * tilt * yaw.at(t);
    plan.position[i] += attitude.sway_m * Vector3d(x.at(t), y.at(t), z.at(t));
    const double surge = config.surge_m * std::sin(2.0 * kPi * t / config.surge_period_s);
    plan.position[i] += surge * Vector3d(std::cos(plan.yaw[i]), std::sin(plan.yaw[i]), 0.0);
  }
}

void add_wave_motion(const MotionConfig& config, const WaveField& waves, Plan& plan) {
  if (waves.calm()) return;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const Vector3d p = plan.position[i];
    const Eigen::Vector2d slope = waves.slope(p.x(), p.y(), -p.z(), plan.t[i]);
    const double c = std::cos(plan.yaw[i]);
    const double s = std::sin(plan.yaw[i]);
    plan.position[i] += config.waves.response * waves.displacement(p.x(), p.y(), -p.z(), plan.t[i]);
    plan.nose_up[i] += config.waves.response * (c * slope.x() + s * slope.y());
    plan.roll[i] += config.waves.response * (-s * slope.x() + c * slope.y());
  }
}

Se3Spline to_spline(const Plan& plan, Stamp start) {
  std::vector<SE3> control;
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const Quaterniond q = AngleAxisd(plan.yaw[i], Vector3d::UnitZ()) *
                          AngleAxisd(-plan.nose_up[i], Vector3d::UnitY()) *
                          AngleAxisd(plan.roll[i], Vector3d::UnitX());
    control.push_back({q, plan.position[i]});
  }
  // The influence of control pose i is centered at knot i - 2 (the middle of its six knots).
  const Duration first = Duration::from_seconds(plan.t.front() + 2.0 * kKnotPeriod_s);
  return Se3Spline(start + first, Duration::from_seconds(kKnotPeriod_s), std::move(control));
}

Plan empty_plan(double duration_s) {
  Plan plan;
  const double from = -kMotionMargin_s - 5.0 * kKnotPeriod_s;
  const double to = duration_s + kMotionMargin_s + 5.0 * kKnotPeriod_s;
  const auto count = static_cast<int>(std::ceil((to - from) / kKnotPeriod_s)) + 1;
  for (int i = 0; i < count; ++i) plan.t.push_back(from + i * kKnotPeriod_s);
  return plan;
}

}  // namespace

WaveField make_waves(const WaveConfig& config, std::uint64_t seed, double gravity) {
  return WaveField(config, Random(seed).fork(kWavesStream), gravity);
}

Se3Spline plan_motion(const MotionConfig& config, const MotionContext& context) {
  if (config.path == PathKind::file) return motion_from_file(config, context);
  Plan plan = empty_plan(context.duration_s);
  if (config.path == PathKind::hover) {
    Vector3d place(config.origin[0], config.origin[1], config.origin[2]);
    if (config.altitude_m && context.height) {
      const auto ground = context.height(place.x(), place.y());
      if (!ground)
        fail_input("motion.altitude_m: no terrain below motion.origin; move it inside the world");
      place.z() = *ground + *config.altitude_m;
    }
    plan.position.assign(plan.size(), place);
  } else {
    constexpr double kSlack = 1.5;  // rounded corners shorten the path
    const double length = kSlack * config.speed_m_s * plan.t.back() + 5.0;
    follow_path(config, dense_path(config, length, context.height), plan);
  }
  set_heading(config, plan);
  set_roll_and_pitch(config, context, plan);
  add_oscillation(config, Random(context.seed).fork(kOscillationStream), plan);
  add_wave_motion(config, make_waves(config.waves, context.seed, context.gravity), plan);
  return to_spline(plan, context.start);
}

}  // namespace apvi::sim
