// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "geometry/spline.hpp"
#include "sim/motion/events.hpp"
#include "sim/render/ray_caster.hpp"

namespace apvi::sim {

/// ideal: no errors, no lost pings; a50: a Water Linked A50, fitted to logs of a real device.
enum class DvlPreset { ideal, a50 };

/// The `dvl` section of a scene. Defaults are those of the preset `a50`; another preset replaces
/// all of them, and keys given in addition override single values. Mounting, beams and latency
/// (`time_offset_s`) come from the rig.
struct DvlSimConfig {
  bool enabled = true;
  DvlPreset preset = DvlPreset::a50;
  std::optional<double> rate_hz;
  double noise_floor = 0.0007;
  double noise_per_speed = 0.008;
  double range_noise = 0.002;
  double range_quantum_m = 0.012;
  double scale_error = 0.003;
  double stamp_jitter_s = 0.004;
  double min_range_m = 0.05;
  double max_range_m = 50.0;
  double max_incidence_deg = 60.0;
  double max_speed_m_s = 3.75;
  double relock_period_s = 10.0;
  double relock_duration_s = 0.35;
  double relock_probability = 0.5;
  double beam_dropout = 0.003;
  double outlier_fraction = 0.0005;
  double max_outlier_m_s = 0.3;

  /// Sets all values to those of a preset.
  void use(DvlPreset other);

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "simulate this sensor");
    const DvlPreset before = preset;
    v("preset", preset,
      config::Choices<DvlPreset>{{"ideal", DvlPreset::ideal}, {"a50", DvlPreset::a50}},
      "device; the keys below override its values");
    if (preset != before) use(preset);
    v("rate_hz", rate_hz, Range{0.1, 50.0}, "ping rate; null: depends on altitude [Hz]");
    v("noise_floor", noise_floor, Range{0.0, 1.0}, "beam velocity noise at rest, one sigma [m/s]");
    v("noise_per_speed", noise_per_speed, Range{0.0, 1.0}, "additional noise per speed, one sigma");
    v("range_noise", range_noise, Range{0.0, 0.5},
      "beam range noise relative to the range, one sigma");
    v("range_quantum_m", range_quantum_m, Range{0.0, 1.0}, "range resolution [m]");
    v("scale_error", scale_error, Range{-0.2, 0.2}, "reported / true velocity - 1");
    v("stamp_jitter_s", stamp_jitter_s, Range{0.0, 1.0}, "jitter of the stamps, one sigma [s]");
    v("min_range_m", min_range_m, Range{0.0, 100.0}, "minimum range along a beam [m]");
    v("max_range_m", max_range_m, Range{0.1, 1000.0}, "maximum range along a beam [m]");
    v("max_incidence_deg", max_incidence_deg, Range{1.0, 90.0},
      "maximum angle of incidence of an echo [deg]");
    v("max_speed_m_s", max_speed_m_s, Range{0.1, 100.0},
      "faster beam velocities are ambiguous [m/s]");
    v("relock_period_s", relock_period_s, Range{1.0, 1e6}, "interval of bottom searches [s]");
    v("relock_duration_s", relock_duration_s, Range{0.0, 10.0},
      "duration of a bottom search, without pings [s]");
    v("relock_probability", relock_probability, Range{0.0, 1.0},
      "probability that a bottom search interrupts the pings");
    v("beam_dropout", beam_dropout, Range{0.0, 1.0}, "probability of a lost beam");
    v("outlier_fraction", outlier_fraction, Range{0.0, 1.0},
      "fraction of beams that are undetected outliers");
    v("max_outlier_m_s", max_outlier_m_s, Range{0.0, 10.0}, "maximum size of an outlier [m/s]");
  }
};

/// Simulates pings from `start` for `duration_s`. A beam is cast from the sensor along the rig's
/// beam vector and is valid when it hits a surface within the limits of the device; its velocity is
/// the dot product of the beam vector and the sensor velocity R_DB (v_B + w x p_BD). The velocity
/// is the least-squares solution over the valid beams; with fewer than three the ping is invalid.
/// Stamps are delayed by the rig's `time_offset_s`.
std::vector<DvlSample> simulate_dvl(const Se3Spline& spline, const RayCaster& world,
                                    const DvlCalibration& dvl, const DvlSimConfig& config,
                                    const EventSchedule& events, Stamp start, double duration_s,
                                    std::uint64_t seed);

/// Least-squares velocity in the sensor frame from the valid beams; nullopt for fewer than three.
std::optional<Eigen::Vector3d> solve_beam_velocity(
    const std::array<std::optional<DvlBeam>, kDvlBeams>& beams,
    const std::array<Eigen::Vector3d, kDvlBeams>& directions);

}  // namespace apvi::sim
