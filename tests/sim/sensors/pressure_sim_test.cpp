// SPDX-License-Identifier: BSD-3-Clause
#include "sim/sensors/pressure_sim.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/core/error.hpp"
#include "sim/motion/motion.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr Stamp kStart{1'700'000'000'000'000'000};
constexpr double kGravity = 9.80665;

Se3Spline motion(PathKind path, double z, double duration_s) {
  MotionConfig config;
  config.path = path;
  config.origin = {0.0, 0.0, z};
  if (path == PathKind::hover) config.attitude = {0, 0, 0, 0, 0, 3.0, 0};
  return plan_motion(config, {.start = kStart, .duration_s = duration_s, .seed = 5, .height = {}});
}

PressureCalibration port() {
  PressureCalibration calibration;
  calibration.p_body_sensor = {0.2, -0.1, 0.3};
  return calibration;
}

PressureSimConfig ideal() {
  PressureSimConfig config;
  config.use(PressurePreset::ideal);
  return config;
}

std::vector<PressureSample> simulate(const Se3Spline& spline, const PressureSimConfig& config,
                                     double duration_s, const EventSchedule& events = {},
                                     const WaveConfig& waves = {}) {
  return simulate_pressure(spline, make_waves(waves, 5, kGravity), port(), config, events, kStart,
                           duration_s, 3);
}

TEST(PressureSim, IsHydrostaticAtThePort) {
  const Se3Spline spline = motion(PathKind::lawnmower, -4.0, 20.0);
  for (const PressureSample& sample : simulate(spline, ideal(), 20.0)) {
    const Vector3d p = spline.at(sample.stamp).T_world_body * port().p_body_sensor;
    EXPECT_NEAR(port().depth(sample.pressure_pa), -p.z(), 1e-9);
  }
}

TEST(PressureSim, NoiseMatchesTheConfiguration) {
  PressureSimConfig config = ideal();
  config.noise_m = 0.004;
  config.rate_hz = 50.0;
  double squares = 0.0;
  const auto samples = simulate(motion(PathKind::hover, -4.0, 400.0), config, 400.0);
  for (const auto& s : samples) squares += std::pow(port().depth(s.pressure_pa) - 3.7, 2);
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(samples.size())) / 0.004, 1.0, 0.05);
}

TEST(PressureSim, BiasRandomWalkMatchesTheConfiguration) {
  PressureSimConfig config = ideal();
  config.bias_walk = 0.002;
  const auto samples = simulate(motion(PathKind::hover, -4.0, 2000.0), config, 2000.0);
  double squares = 0.0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double step =
        port().depth(samples[i].pressure_pa) - port().depth(samples[i - 1].pressure_pa);
    squares += step * step;
  }
  EXPECT_NEAR(std::sqrt(squares / 2000.0) / 0.002, 1.0, 0.05);
}

TEST(PressureSim, ReadingsAreMultiplesOfTheResolution) {
  const auto samples = simulate(motion(PathKind::lawnmower, -4.0, 10.0), PressureSimConfig{}, 10.0);
  for (const auto& s : samples) EXPECT_NEAR(std::remainder(s.pressure_pa, 20.0), 0.0, 1e-6);
}

TEST(PressureSim, WavePressureDecaysWithDepth) {
  const auto swing = [](double z) {
    double largest = 0.0;
    for (const auto& s : simulate(motion(PathKind::hover, z, 60.0), ideal(), 60.0, {},
                                  WaveConfig{.height_m = 1.0})) {
      largest = std::max(largest, std::abs(port().depth(s.pressure_pa) + z + 0.3));
    }
    return largest;
  };
  EXPECT_GT(swing(-1.0), 0.2);
  EXPECT_LT(swing(-20.0), 0.2 * swing(-1.0));
}

TEST(PressureSim, SpikesOccurOnlyDuringTheEvent) {
  const EventSchedule events({{EventKind::pressure_spikes, 5.0, 10.0, 3.0, 0.0}}, 20.0, 5.0);
  int spikes = 0;
  for (const auto& s : simulate(motion(PathKind::hover, -8.0, 20.0), ideal(), 20.0, events)) {
    const double t = seconds_between(kStart, s.stamp);
    const double error = std::abs(port().depth(s.pressure_pa) - 7.7);
    if (error < 1e-6) continue;
    EXPECT_NEAR(error, 3.0, 1e-6);
    EXPECT_TRUE(t >= 5.0 && t < 10.0) << t;
    ++spikes;
  }
  EXPECT_GT(spikes, 3);
}

TEST(PressureSim, StampsAreDelayedByTheTimeOffset) {
  PressureSimConfig config = ideal();
  config.time_offset_s = 0.02;
  const auto samples = simulate(motion(PathKind::hover, -4.0, 1.0), config, 1.0);
  EXPECT_EQ((samples.front().stamp - kStart).ns, 20'000'000);
}

TEST(PressureSim, ThrowsWhenPortIsAboveWater) {
  EXPECT_THROW(simulate(motion(PathKind::hover, -0.1, 1.0), ideal(), 1.0), InputError);
}

}  // namespace
}  // namespace apvi::sim
