// SPDX-License-Identifier: BSD-3-Clause
#include "sim/sensors/imu_sim.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/so3.hpp"
#include "sim/motion/motion.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr Stamp kStart{1'700'000'000'000'000'000};
constexpr double kGravity = 9.80665;

Se3Spline motion(PathKind path, double duration_s) {
  MotionConfig config;
  config.path = path;
  config.origin = {0.0, 0.0, -5.0};
  if (path == PathKind::hover) config.attitude = {0, 0, 0, 0, 0, 3.0, 0};
  return plan_motion(config, {.start = kStart, .duration_s = duration_s, .seed = 5, .height = {}});
}

ImuSimConfig only(ImuPreset preset) {
  ImuSimConfig config;
  config.use(preset);
  return config;
}

ImuRecord simulate(const Se3Spline& spline, const ImuSimConfig& config, double duration_s,
                   const EventSchedule& events = {}) {
  return simulate_imu(spline, config, events, kStart, duration_s, kGravity, 7);
}

// Overlapping Allan deviation for an averaging time of `m` samples.
double allan_deviation(const std::vector<double>& rate, double rate_hz, std::size_t m) {
  std::vector<double> sum{0.0};
  for (const double value : rate) sum.push_back(sum.back() + value / rate_hz);
  const double tau = static_cast<double>(m) / rate_hz;
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i + 2 * m < sum.size(); ++i, ++count) {
    squares += std::pow(sum[i + 2 * m] - 2.0 * sum[i + m] + sum[i], 2);
  }
  return std::sqrt(squares / (2.0 * tau * tau * static_cast<double>(count)));
}

// RMS over the axes of the Allan deviations of gyroscope and accelerometer.
std::pair<double, double> allan(const ImuRecord& record, double rate_hz, std::size_t m) {
  double gyro = 0.0;
  double accel = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> w;
    std::vector<double> a;
    for (const ImuSample& sample : record.samples) {
      w.push_back(sample.gyro[axis]);
      a.push_back(sample.accel[axis]);
    }
    gyro += std::pow(allan_deviation(w, rate_hz, m), 2) / 3.0;
    accel += std::pow(allan_deviation(a, rate_hz, m), 2) / 3.0;
  }
  return {std::sqrt(gyro), std::sqrt(accel)};
}

TEST(ImuSim, StaticRigReadsGravity) {
  const ImuRecord record = simulate(motion(PathKind::hover, 2.0), only(ImuPreset::ideal), 2.0);
  ASSERT_EQ(record.samples.size(), 401U);
  for (const ImuSample& sample : record.samples) {
    EXPECT_LT((sample.accel - Vector3d(0, 0, kGravity)).norm(), 1e-9);
    EXPECT_LT(sample.gyro.norm(), 1e-12);
  }
}

TEST(ImuSim, StampsAreExact) {
  ImuSimConfig config = only(ImuPreset::ideal);
  config.rate_hz = 300.0;
  const ImuRecord record = simulate(motion(PathKind::hover, 2.0), config, 2.0);
  EXPECT_EQ(record.samples[1].stamp.ns, kStart.ns + 3'333'333);
  EXPECT_EQ(record.samples[300].stamp.ns, kStart.ns + 1'000'000'000);
}

TEST(ImuSim, IntegratedReadingsReproduceTheTrajectory) {
  constexpr double kDuration = 60.0;
  const Se3Spline spline = motion(PathKind::lawnmower, kDuration);
  const ImuRecord record = simulate(spline, only(ImuPreset::ideal), kDuration);
  SE3 pose = record.truth.front().T_world_body;
  Vector3d velocity = record.truth.front().velocity_world;
  for (std::size_t i = 1; i < record.samples.size(); ++i) {
    const ImuSample& a = record.samples[i - 1];
    const ImuSample& b = record.samples[i];
    const double dt = seconds_between(a.stamp, b.stamp);
    const Eigen::Quaterniond next = pose.rotation * so3::exp(0.5 * dt * (a.gyro + b.gyro) +
                                                             dt * dt / 12.0 * a.gyro.cross(b.gyro));
    const Vector3d from = pose.rotation * a.accel - Vector3d(0, 0, kGravity);
    const Vector3d to = next * b.accel - Vector3d(0, 0, kGravity);
    pose.translation += dt * velocity + dt * dt / 6.0 * (2.0 * from + to);
    velocity += 0.5 * dt * (from + to);
    pose.rotation = next.normalized();
  }
  const SE3& truth = record.truth.back().T_world_body;
  EXPECT_LT((pose.translation - truth.translation).norm(), 5e-3);
  EXPECT_LT(so3::angle_between(pose.rotation, truth.rotation), 1e-5);
}

TEST(ImuSim, WhiteNoiseMatchesConfiguredAllanDeviation) {
  constexpr double kDuration = 1800.0;
  ImuSimConfig config = only(ImuPreset::mems);
  config.gyro_random_walk = config.accel_random_walk = 0.0;
  const ImuRecord record = simulate(motion(PathKind::hover, kDuration), config, kDuration);
  for (const std::size_t m : {1U, 20U, 200U}) {
    const double tau = static_cast<double>(m) / config.rate_hz;
    const auto [gyro, accel] = allan(record, config.rate_hz, m);
    EXPECT_NEAR(gyro * std::sqrt(tau) / config.gyro_noise_density, 1.0, 0.05) << tau;
    EXPECT_NEAR(accel * std::sqrt(tau) / config.accel_noise_density, 1.0, 0.05) << tau;
  }
}

TEST(ImuSim, BiasRandomWalkMatchesConfiguredAllanDeviation) {
  constexpr double kDuration = 3600.0;
  ImuSimConfig config = only(ImuPreset::ideal);
  config.rate_hz = 50.0;
  config.gyro_random_walk = 1e-4;
  config.accel_random_walk = 1e-3;
  const ImuRecord record = simulate(motion(PathKind::hover, kDuration), config, kDuration);
  const std::size_t m = 250;  // 5 s: Allan deviation = walk * sqrt(tau / 3)
  const auto [gyro, accel] = allan(record, config.rate_hz, m);
  EXPECT_NEAR(gyro / (config.gyro_random_walk * std::sqrt(5.0 / 3.0)), 1.0, 0.05);
  EXPECT_NEAR(accel / (config.accel_random_walk * std::sqrt(5.0 / 3.0)), 1.0, 0.05);
}

TEST(ImuSim, GroundTruthContainsTheBiases) {
  ImuSimConfig config = only(ImuPreset::consumer);
  config.scale_error = config.misalignment_deg = 0.0;
  constexpr double kDuration = 100.0;
  const ImuRecord record = simulate(motion(PathKind::hover, kDuration), config, kDuration);
  Vector3d gyro = Vector3d::Zero();
  Vector3d accel = Vector3d::Zero();
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    gyro += record.samples[i].gyro - record.gyro_bias[i];
    accel += record.samples[i].accel - record.accel_bias[i];
  }
  const double n = static_cast<double>(record.samples.size());
  EXPECT_LT((gyro / n).norm(), 4.0 * config.gyro_noise_density / std::sqrt(kDuration));
  EXPECT_LT((accel / n - Vector3d(0, 0, kGravity)).norm(),
            4.0 * config.accel_noise_density / std::sqrt(kDuration));
  EXPECT_GT(record.accel_bias.front().norm(), 0.01);
}

TEST(ImuSim, ScaleErrorIsProportionalToTheSignal) {
  ImuSimConfig config = only(ImuPreset::ideal);
  config.scale_error = 0.01;
  const ImuRecord record = simulate(motion(PathKind::hover, 1.0), config, 1.0);
  const double error = std::abs(record.samples.front().accel.z() / kGravity - 1.0);
  EXPECT_GT(error, 1e-5);
  EXPECT_LT(error, 0.04);
}

TEST(ImuSim, ReadingsSaturateDuringSaturationEvent) {
  ImuSimConfig config = only(ImuPreset::mems);
  const EventSchedule events({{EventKind::imu_saturation, 0.5, 1.0, 0.0, 0.0}}, 2.0, 5.0);
  const ImuRecord record = simulate(motion(PathKind::hover, 2.0), config, 2.0, events);
  int clipped = 0;
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    const double largest = record.samples[i].accel.cwiseAbs().maxCoeff();
    EXPECT_LE(largest, config.accel_range);
    EXPECT_LT(record.samples[i].gyro.norm(), 0.1 * config.gyro_range);
    const bool inside = i >= 100 && i < 200;
    if (!inside) {
      EXPECT_LT(largest, 11.0) << i;
    }
    if (inside && largest == config.accel_range) ++clipped;
  }
  EXPECT_GT(clipped, 50);
}

TEST(ImuSim, MeasuresEarthRotationWhenEnabled) {
  ImuSimConfig config = only(ImuPreset::ideal);
  config.earth_rotation = true;
  config.latitude_deg = 90.0;
  const ImuRecord record = simulate(motion(PathKind::hover, 1.0), config, 1.0);
  EXPECT_NEAR(record.samples.front().gyro.z(), 7.292115e-5, 1e-10);
}

TEST(ImuSim, KeysOverrideValuesOfAPreset) {
  ImuSimConfig config;
  config::read(config::parse_yaml("preset: tactical\ngyro_bias_sigma: 0.1\n", "test"), config);
  ImuSimConfig tactical = only(ImuPreset::tactical);
  EXPECT_EQ(config.gyro_bias_sigma, 0.1);
  EXPECT_EQ(config.gyro_noise_density, tactical.gyro_noise_density);
  EXPECT_NE(config.gyro_noise_density, ImuSimConfig{}.gyro_noise_density);
}

}  // namespace
}  // namespace apvi::sim
