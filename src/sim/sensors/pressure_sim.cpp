// SPDX-License-Identifier: BSD-3-Clause
#include "sim/sensors/pressure_sim.hpp"

#include <cmath>

#include "apvi/core/error.hpp"
#include "core/random.hpp"

namespace apvi::sim {
namespace {

constexpr std::uint64_t kPressureStream = 41;

// Depth equivalent of the true pressure: hydrostatic plus wave pressure [m].
double equivalent_depth(const Se3Spline& spline, const WaveField& waves,
                        const Eigen::Vector3d& p_body, Stamp stamp, double t) {
  const Eigen::Vector3d p = spline.at(stamp).T_world_body * p_body;
  const double depth = -p.z();
  if (depth < 0.0) {
    fail_input(
        "motion: the pressure sensor is {:.2f} m above the water at {:.1f} s; lower the path",
        -depth, t);
  }
  return waves.calm() ? depth : depth + waves.pressure_head(p.x(), p.y(), depth, t);
}

}  // namespace

void PressureSimConfig::use(PressurePreset other) {
  const bool was_enabled = enabled;
  *this = PressureSimConfig{};
  enabled = was_enabled;
  preset = other;
  if (other == PressurePreset::ideal) noise_m = bias_m = bias_walk = resolution_pa = 0.0;
}

std::vector<PressureSample> simulate_pressure(const Se3Spline& spline, const WaveField& waves,
                                              const PressureCalibration& calibration,
                                              const PressureSimConfig& config,
                                              const EventSchedule& events, Stamp start,
                                              double duration_s, std::uint64_t seed) {
  Random random = Random(seed).fork(kPressureStream);
  const double per_meter = calibration.water_density * calibration.gravity;
  const double step = config.bias_walk / std::sqrt(config.rate_hz);
  double bias = config.bias_m * random.normal();
  std::vector<PressureSample> samples;
  const auto count = static_cast<std::int64_t>(std::floor(duration_s * config.rate_hz + 1e-6)) + 1;
  for (std::int64_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) / config.rate_hz;
    const Stamp truth = start + Duration::from_seconds(t);
    double depth = equivalent_depth(spline, waves, calibration.p_body_sensor, truth, t);
    depth += bias + config.noise_m * random.normal();
    bias += step * random.normal();
    constexpr double kSpikeFraction = 0.1;
    const bool spike = random.uniform() < kSpikeFraction;
    const double sign = random.uniform() < 0.5 ? -1.0 : 1.0;
    if (spike) depth += sign * events.strength(EventKind::pressure_spikes, t);
    double pressure = calibration.atmospheric_pressure_pa + per_meter * depth;
    if (config.resolution_pa > 0.0) {
      pressure = config.resolution_pa * std::round(pressure / config.resolution_pa);
    }
    samples.push_back({truth + Duration::from_seconds(config.time_offset_s), pressure});
  }
  return samples;
}

}  // namespace apvi::sim
