// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/spline.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/sim/events.hpp"
#include "apvi/sim/waves.hpp"

namespace apvi::sim {

/// ideal: no error; bar30: a Blue Robotics Bar30 (MS5837-30BA, 0.2 mbar steps), noise as in real
/// logs.
enum class PressurePreset { ideal, bar30 };

/// The `pressure` section of a scene. The numbers are those of the preset `bar30`; another preset
/// replaces them all, and keys given beside it replace single ones. The lever arm is the rig's.
struct PressureSimConfig {
  bool enabled = true;
  PressurePreset preset = PressurePreset::bar30;
  double rate_hz = 20.0;
  double noise_m = 0.003;
  double bias_m = 0.02;
  double bias_walk = 0.0005;
  double resolution_pa = 20.0;
  double time_offset_s = 0.0;

  /// Takes the numbers of a device.
  void use(PressurePreset other);

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "whether the vehicle has one");
    const PressurePreset before = preset;
    v("preset", preset,
      config::Choices<PressurePreset>{{"ideal", PressurePreset::ideal},
                                      {"bar30", PressurePreset::bar30}},
      "device; the keys below replace single numbers of it");
    if (preset != before) use(preset);
    v("rate_hz", rate_hz, Range{0.1, 1000.0}, "sample rate [Hz]");
    v("noise_m", noise_m, Range{0.0, 10.0}, "white noise as depth, one sigma [m]");
    v("bias_m", bias_m, Range{0.0, 100.0}, "constant error as depth, one sigma [m]");
    v("bias_walk", bias_walk, Range{0.0, 1.0}, "its walk, as depth [m/sqrt(s)]");
    v("resolution_pa", resolution_pa, Range{0.0, 1e5}, "readings are multiples of this [Pa]");
    v("time_offset_s", time_offset_s, Range{-1.0, 1.0}, "by how much the stamps are late [s]");
  }
};

/// Absolute pressure at the sensor's port: hydrostatic below z = 0, the waves' share, the device's
/// errors. Throws InputError when the port comes out of the water.
std::vector<PressureSample> simulate_pressure(const Se3Spline& spline, const WaveField& waves,
                                              const PressureCalibration& calibration,
                                              const PressureSimConfig& config,
                                              const EventSchedule& events, Stamp start,
                                              double duration_s, std::uint64_t seed);

}  // namespace apvi::sim
