// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "geometry/spline.hpp"
#include "sim/motion/events.hpp"
#include "sim/motion/waves.hpp"

namespace apvi::sim {

/// ideal: no errors; bar30: a Blue Robotics Bar30 (MS5837-30BA, 0.2 mbar steps), noise from real
/// logs.
enum class PressurePreset { ideal, bar30 };

/// The `pressure` section of a scene. Defaults are those of the preset `bar30`; another preset
/// replaces all of them, and keys given in addition override single values. The lever arm comes
/// from the rig.
struct PressureSimConfig {
  bool enabled = true;
  PressurePreset preset = PressurePreset::bar30;
  double rate_hz = 20.0;
  double noise_m = 0.003;
  double bias_m = 0.02;
  double bias_walk = 0.0005;
  double resolution_pa = 20.0;
  double time_offset_s = 0.0;

  /// Sets all values to those of a preset.
  void use(PressurePreset other);

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "simulate this sensor");
    const PressurePreset before = preset;
    v("preset", preset,
      config::Choices<PressurePreset>{{"ideal", PressurePreset::ideal},
                                      {"bar30", PressurePreset::bar30}},
      "device; the keys below override its values");
    if (preset != before) use(preset);
    v("rate_hz", rate_hz, Range{0.1, 1000.0}, "sample rate [Hz]");
    v("noise_m", noise_m, Range{0.0, 10.0}, "white noise as depth, one sigma [m]");
    v("bias_m", bias_m, Range{0.0, 100.0}, "constant bias as depth, one sigma [m]");
    v("bias_walk", bias_walk, Range{0.0, 1.0}, "bias random walk as depth [m/sqrt(s)]");
    v("resolution_pa", resolution_pa, Range{0.0, 1e5}, "resolution [Pa]");
    v("time_offset_s", time_offset_s, Range{-1.0, 1.0}, "how late the stamps are [s]");
  }
};

/// Simulates the absolute pressure at the sensor port: hydrostatic pressure below z = 0, wave
/// pressure and sensor errors. Throws InputError when the port is above the water surface.
std::vector<PressureSample> simulate_pressure(const Se3Spline& spline, const WaveField& waves,
                                              const PressureCalibration& calibration,
                                              const PressureSimConfig& config,
                                              const EventSchedule& events, Stamp start,
                                              double duration_s, std::uint64_t seed);

}  // namespace apvi::sim
