// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kMinAirPressure = 50'000.0;  // at a mountain lake [Pa]
constexpr double kMaxPressure = 1.2e8;        // [Pa]
constexpr double kMaxNegativeFraction = 0.05;
constexpr double kMinHighest = -0.1;  // of a recording: the offset of a sensor at the surface [m]

void check_pressure_unit(const DepthObservations& observed, Report& report) {
  const double median = observed.value.median();
  Finding f{Severity::ok, "pressure0",
            "unit",       fmt::format("median {:.5g} Pa", median),
            "",           {{"median_pa", median}}};
  if (median < kMinAirPressure || median > kMaxPressure) f.severity = Severity::error;
  if (median > kMaxPressure) {
    f.advice = "deeper than any ocean: check the unit, see dataset.pressure_unit";
  } else if (median >= 500.0 && median < 20'000.0) {
    f.advice = "these look like hPa (mbar): set dataset.pressure_unit: hPa, or the header's unit";
  } else if (median >= 50.0 && median < 500.0) {
    f.advice = "these look like kPa: set dataset.pressure_unit: kPa, or the header's unit";
  } else if (f.severity == Severity::error) {
    f.advice =
        "below atmospheric pressure: wrong unit, or gauge pressure (then set "
        "pressure0.atmospheric_pressure_pa: 0 in the rig)";
  }
  report.add(std::move(f));
}

void check_range(const DepthObservations& observed, const std::string& name, Report& report) {
  const double above =
      static_cast<double>(observed.negative) / static_cast<double>(observed.timing.count);
  Finding f{Severity::ok, name,
            "depth",      fmt::format("{:.2f} to {:.2f} m", observed.lowest, observed.highest),
            "",           {{"lowest_m", observed.lowest}, {"highest_m", observed.highest}}};
  const bool never_below = observed.highest < kMinHighest;
  if (above > kMaxNegativeFraction || never_below) {
    f.severity = Severity::warning;
    f.message +=
        never_below ? "; never below the surface"
                    : fmt::format("; {:.0f} % of the samples are above the surface", 100.0 * above);
    f.advice = name == "depth0" ? "depth is positive downward: are these heights?"
                                : "check pressure0.atmospheric_pressure_pa in the rig";
  } else if (observed.timing.count > 20 && observed.depth_step.count() == 0) {
    f.severity = Severity::warning;
    f.message += "; it never changes";
    f.advice = "clogged pressure port, or the driver hangs";
  }
  report.add(std::move(f));
}

void check_resolution(const DepthObservations& observed, const std::string& name, double noise_m,
                      Report& report) {
  const double step = observed.depth_step.quantile(0.05);
  // With few repeats the steps are the sensor's noise, not its resolution.
  const double repeats =
      static_cast<double>(observed.timing.repeated) / static_cast<double>(observed.timing.count);
  if (observed.depth_step.count() < 10 || repeats < 0.3) return;
  Finding f{Severity::ok,      name, "resolution", fmt::format("steps of {:.3g} m", step), "",
            {{"step_m", step}}};
  if (step > 2.0 * noise_m) {
    f.severity = Severity::note;
    f.advice = fmt::format("coarser than {}.noise_m of {:.3g}: set it to {:.2g} or more in the rig",
                           name, noise_m, 0.5 * step);
  }
  report.add(std::move(f));
}

void check_spikes(const DepthObservations& observed, const std::string& name, Report& report) {
  if (observed.spikes == 0) return;
  report.add({Severity::warning,
              name,
              "spikes",
              fmt::format("{} jumps of depth too fast for any vehicle", observed.spikes),
              "outlier rejection must handle them; look for electrical noise or lost bytes",
              {{"count", static_cast<double>(observed.spikes)}}});
}

void check_one(const DepthObservations& observed, const std::string& name, double noise_m,
               Report& report) {
  if (observed.timing.count == 0) return;
  check_range(observed, name, report);
  check_resolution(observed, name, noise_m, report);
  check_spikes(observed, name, report);
}

}  // namespace

void check_depth(const CheckInput& c, Report& report) {
  if (c.observed.pressure.timing.count > 0) check_pressure_unit(c.observed.pressure, report);
  check_one(c.observed.pressure, "pressure0",
            c.rig.pressure.value_or(PressureCalibration{}).noise_m, report);
  check_one(c.observed.depth, "depth0", c.rig.depth.value_or(PressureDepthCalibration{}).noise_m,
            report);
}

}  // namespace apvi::doctor
