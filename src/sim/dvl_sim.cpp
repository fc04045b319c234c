// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sim/dvl_sim.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "apvi/core/random.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Directions = std::array<Vector3d, kDvlBeams>;

constexpr std::uint64_t kDvlStream = 31;
constexpr double kNoSolution = 10.0;  // figure of merit of a ping without velocity
constexpr std::size_t kMinBeams = 3;

// Altitudes and ping rates of the A50's range modes (Water Linked's manual), the third and fourth
// rate as logs show them at 9 m (5.3 Hz) and 11.5 m (4.0 Hz).
struct RangeMode {
  double low_m;
  double high_m;
  double rate_hz;
};
constexpr std::array<RangeMode, 5> kModes{
    {{0.05, 0.6, 15.0}, {0.3, 3.0, 8.8}, {1.5, 14.0, 5.25}, {7.7, 36.0, 4.0}, {15.0, 60.0, 3.0}}};
constexpr double kSearchRate = 4.0;  // without bottom [Hz]

// The device stays in its mode as long as the altitude is inside, then takes the fastest that fits.
class RateByAltitude {
 public:
  double rate(std::optional<double> altitude_m) {
    if (!altitude_m) return kSearchRate;
    const auto fits = [&](const RangeMode& mode) {
      return *altitude_m >= mode.low_m && *altitude_m <= mode.high_m;
    };
    if (mode_ == nullptr || !fits(*mode_)) {
      const auto found = std::find_if(kModes.begin(), kModes.end(), fits);
      mode_ = found == kModes.end() ? &kModes.back() : &*found;
    }
    return mode_->rate_hz;
  }

 private:
  const RangeMode* mode_ = nullptr;
};

// When the periodic search for the bottom swallows pings.
class Relock {
 public:
  Relock(const DvlSimConfig& config, Random& random)
      : config_(config), phase_(random.uniform(0.0, config.relock_period_s)), key_(random.next()) {}

  bool searching(double t) const {
    const double cycle = std::floor((t + phase_) / config_.relock_period_s);
    const double since = t + phase_ - cycle * config_.relock_period_s;
    Random draw = Random(key_).fork(static_cast<std::uint64_t>(static_cast<std::int64_t>(cycle)));
    return since < config_.relock_s && draw.uniform() < config_.relock_share;
  }

 private:
  const DvlSimConfig& config_;
  double phase_;
  std::uint64_t key_;
};

// The sensor at the instant of a ping.
struct Sensor {
  SE3 T_world_dvl;
  Vector3d velocity;  // of the sensor over ground, sensor frame
};

Sensor sensor_at(const Se3Spline& spline, const SE3& T_body_dvl, Stamp stamp) {
  const Motion motion = spline.at(stamp);
  const Vector3d v_body = motion.T_world_body.rotation.conjugate() * motion.velocity_world;
  const Vector3d lever = motion.angular_velocity_body.cross(T_body_dvl.translation);
  return {motion.T_world_body * T_body_dvl, T_body_dvl.rotation.conjugate() * (v_body + lever)};
}

// Rays that stand for a beam: its axis and a ring about it, well inside the half-power width of 4.4
// degrees.
constexpr int kRing = 6;
constexpr double kRingAngle = 1.4 * std::numbers::pi / 180.0;

// Range of the surface along one ray if it faces the ray enough to send sound back.
std::optional<double> ray_echo(const Vector3d& origin, const Vector3d& direction,
                               const RayCaster& world, const DvlSimConfig& config) {
  const auto hit = world.cast(origin, direction, config.max_range_m);
  if (!hit || hit->range < config.min_range_m) return std::nullopt;
  const double limit = std::cos(config.max_incidence_deg * std::numbers::pi / 180.0);
  if (std::abs(hit->normal.dot(direction)) < limit) return std::nullopt;
  return hit->range;
}

// Mean range over the footprint if enough of it sends sound back: a single stone on edge does not
// silence a beam.
std::optional<double> echo(const Sensor& sensor, const Vector3d& beam, const RayCaster& world,
                           const DvlSimConfig& config) {
  const Vector3d axis = (sensor.T_world_dvl.rotation * beam).normalized();
  const Vector3d side = axis.unitOrthogonal();
  const Vector3d other = axis.cross(side);
  double sum = 0.0;
  int count = 0;
  for (int i = 0; i <= kRing; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / kRing;
    const double tilt = i < kRing ? std::tan(kRingAngle) : 0.0;
    const Vector3d direction =
        (axis + tilt * (std::cos(turn) * side + std::sin(turn) * other)).normalized();
    const auto range = ray_echo(sensor.T_world_dvl.translation, direction, world, config);
    if (!range) continue;
    sum += *range;
    ++count;
  }
  constexpr int kEnough = (kRing + 1) / 2;
  if (count < kEnough) return std::nullopt;
  return sum / count;
}

double quantised(double value, double quantum) {
  return quantum > 0.0 ? quantum * std::round(value / quantum) : value;
}

DvlBeam read_beam(const Sensor& sensor, const Vector3d& direction, const RayCaster& world,
                  const DvlSimConfig& config, Random& random) {
  // All draws are made whatever happens, so that one switch does not change the other noise.
  const double noise = random.normal();
  const double range_noise = random.normal();
  const bool dropped = random.uniform() < config.beam_dropout;
  const bool lies = random.uniform() < config.outlier_share;
  const double lie = random.uniform(-config.outlier_m_s, config.outlier_m_s);
  const double truth = direction.dot(sensor.velocity);
  const auto range = echo(sensor, direction, world, config);
  if (!range || dropped || std::abs(truth) > config.max_speed_m_s) {
    return {.velocity = 0.0, .range = -1.0, .valid = false};
  }
  const double sigma =
      std::hypot(config.noise_floor, config.noise_per_speed * sensor.velocity.norm());
  return {
      .velocity = (1.0 + config.scale_error) * truth + sigma * noise + (lies ? lie : 0.0),
      .range = quantised(*range * (1.0 + config.range_noise * range_noise), config.range_quantum_m),
      .valid = true};
}

// Multipath moves the velocity as a whole in one half of the cases, one beam in the other.
void add_outlier(DvlSample& sample, double size, const Directions& directions, Random& random) {
  constexpr double kShare = 1.0 / 3.0;
  const bool happens = random.uniform() < kShare;
  const bool whole = random.uniform() < 0.5;
  const auto beam = static_cast<std::size_t>(random.uniform() * kDvlBeams);
  const double sign = random.uniform() < 0.5 ? -1.0 : 1.0;
  Vector3d push(random.normal(), random.normal(), 0.3 * random.normal());
  push *= size / std::max(push.norm(), 1e-9);
  for (std::size_t i = 0; i < kDvlBeams && happens && size > 0.0; ++i) {
    if (!sample.beams[i]->valid) continue;
    if (whole) sample.beams[i]->velocity += directions[i].dot(push);
    if (!whole && i == beam) sample.beams[i]->velocity += sign * size;
  }
}

std::optional<double> altitude_of(const DvlSample& sample, const Directions& directions) {
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    if (!sample.beams[i]->valid) continue;
    sum += *sample.beams[i]->range * std::abs(directions[i].z());
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

void lose_bottom(DvlSample& sample) {
  for (auto& beam : sample.beams) beam = DvlBeam{.velocity = 0.0, .range = -1.0, .valid = false};
}

// What the device computes from its beams.
void solve(DvlSample& sample, const Directions& directions, Random& random) {
  const double spread = std::exp(0.1 * random.normal());
  const auto velocity = velocity_of_beams(sample.beams, directions);
  const auto altitude = altitude_of(sample, directions);
  sample.valid = velocity.has_value();
  sample.velocity = velocity.value_or(Vector3d::Zero());
  sample.altitude = sample.valid ? altitude.value_or(-1.0) : -1.0;
  // In logs the figure of merit grows with the altitude and says little else: 0.03 at 2 m, 0.14 at
  // 9 m.
  constexpr double kMeritPerMetre = 0.0155;
  sample.figure_of_merit = sample.valid ? kMeritPerMetre * *sample.altitude * spread : kNoSolution;
}

}  // namespace

void DvlSimConfig::use(DvlPreset other) {
  const bool was_enabled = enabled;
  *this = DvlSimConfig{};
  enabled = was_enabled;
  preset = other;
  if (other == DvlPreset::a50) return;
  noise_floor = noise_per_speed = range_noise = range_quantum_m = 0.0;
  scale_error = stamp_jitter_s = 0.0;
  relock_share = beam_dropout = outlier_share = 0.0;
}

std::optional<Vector3d> velocity_of_beams(
    const std::array<std::optional<DvlBeam>, kDvlBeams>& beams, const Directions& directions) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  std::size_t count = 0;
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    if (!beams[i] || !beams[i]->valid) continue;
    normal += directions[i] * directions[i].transpose();
    right += directions[i] * beams[i]->velocity;
    ++count;
  }
  if (count < kMinBeams) return std::nullopt;
  return normal.ldlt().solve(right);
}

std::vector<DvlSample> simulate_dvl(const Se3Spline& spline, const RayCaster& world,
                                    const DvlCalibration& dvl, const DvlSimConfig& config,
                                    const EventSchedule& events, Stamp start, double duration_s,
                                    std::uint64_t seed) {
  Random random = Random(seed).fork(kDvlStream);
  const Relock relock(config, random);
  RateByAltitude mode;
  std::vector<DvlSample> samples;
  double t = random.uniform(0.0, 0.1) + std::max(0.0, -dvl.time_offset_s);
  while (t + dvl.time_offset_s <= duration_s) {
    const Stamp truth = start + Duration::from_seconds(t);
    const Sensor sensor = sensor_at(spline, dvl.T_body_dvl, truth);
    DvlSample sample;
    for (std::size_t i = 0; i < kDvlBeams; ++i) {
      sample.beams[i] = read_beam(sensor, dvl.beams[i], world, config, random);
    }
    const double rate = config.rate_hz.value_or(mode.rate(altitude_of(sample, dvl.beams)));
    add_outlier(sample, events.strength(EventKind::dvl_outliers, t), dvl.beams, random);
    if (random.uniform() < events.strength(EventKind::dvl_loss, t)) lose_bottom(sample);
    solve(sample, dvl.beams, random);
    const double jitter =
        std::clamp(config.stamp_jitter_s * random.normal(), -0.2 / rate, 0.2 / rate);
    sample.stamp = truth + Duration::from_seconds(dvl.time_offset_s + jitter);
    if (!relock.searching(t) && sample.stamp >= start) samples.push_back(sample);
    t += 1.0 / rate;
  }
  return samples;
}

}  // namespace apvi::sim
