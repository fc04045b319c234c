// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kLowestAir = 50'000.0;  // on a mountain lake [Pa]
constexpr double kDeep = 1.2e8;          // [Pa]
constexpr double kSomeNegative = 0.05;

void check_pressure_unit(const DepthObservations& seen, Report& report) {
  const double median = seen.value.median();
  Finding f{Severity::ok, "pressure0",
            "unit",       fmt::format("median {:.5g} Pa", median),
            "",           {{"median_pa", median}}};
  if (median < kLowestAir || median > kDeep) f.severity = Severity::error;
  if (median > kDeep) {
    f.advice = "deeper than any ocean: is the unit right? see dataset.pressure_unit";
  } else if (median >= 500.0 && median < 20'000.0) {
    f.advice = "these look like hPa (mbar): set dataset.pressure_unit: hPa, or the header's unit";
  } else if (median >= 50.0 && median < 500.0) {
    f.advice = "these look like kPa: set dataset.pressure_unit: kPa, or the header's unit";
  } else if (f.severity == Severity::error) {
    f.advice =
        "less than air: another unit, or pressure above the surface's (then set "
        "pressure0.atmospheric_pressure_pa: 0 in the rig)";
  }
  report.add(std::move(f));
}

void check_range(const DepthObservations& seen, const std::string& name, Report& report) {
  const double above = static_cast<double>(seen.negative) / static_cast<double>(seen.timing.count);
  Finding f{Severity::ok, name,
            "depth",      fmt::format("{:.2f} to {:.2f} m", seen.lowest, seen.highest),
            "",           {{"lowest_m", seen.lowest}, {"highest_m", seen.highest}}};
  if (above > kSomeNegative) {
    f.severity = Severity::warning;
    f.message += fmt::format("; {:.0f} % of the samples are above the surface", 100.0 * above);
    f.advice = name == "depth0" ? "depth grows downwards: are these heights?"
                                : "check pressure0.atmospheric_pressure_pa in the rig";
  } else if (seen.timing.count > 20 && seen.depth_step.count() == 0) {
    f.severity = Severity::warning;
    f.message += "; it never changes";
    f.advice = "a clogged port, or a driver that hangs";
  }
  report.add(std::move(f));
}

void check_resolution(const DepthObservations& seen, const std::string& name, double noise_m,
                      Report& report) {
  const double step = seen.depth_step.quantile(0.05);
  // Two or three values in all would be the sensor's noise, not its steps.
  const double repeats =
      static_cast<double>(seen.timing.repeated) / static_cast<double>(seen.timing.count);
  if (seen.depth_step.count() < 10 || repeats < 0.3) return;
  Finding f{Severity::ok,      name, "resolution", fmt::format("steps of {:.3g} m", step), "",
            {{"step_m", step}}};
  if (step > 2.0 * noise_m) {
    f.severity = Severity::note;
    f.advice =
        fmt::format("coarse against {}.noise_m of {:.3g}: set it to {:.2g} or more in the rig",
                    name, noise_m, 0.5 * step);
  }
  report.add(std::move(f));
}

void check_spikes(const DepthObservations& seen, const std::string& name, Report& report) {
  if (seen.spikes == 0) return;
  report.add({Severity::warning,
              name,
              "spikes",
              fmt::format("{} jumps of the depth that no vehicle can make", seen.spikes),
              "the gate will have to find them; look for electrical noise or lost bytes",
              {{"count", static_cast<double>(seen.spikes)}}});
}

void check_one(const DepthObservations& seen, const std::string& name, double noise_m,
               Report& report) {
  if (seen.timing.count == 0) return;
  check_range(seen, name, report);
  check_resolution(seen, name, noise_m, report);
  check_spikes(seen, name, report);
}

}  // namespace

void check_depth(const Case& c, Report& report) {
  if (c.seen.pressure.timing.count > 0) check_pressure_unit(c.seen.pressure, report);
  check_one(c.seen.pressure, "pressure0", c.rig.pressure.value_or(PressureCalibration{}).noise_m,
            report);
  check_one(c.seen.depth, "depth0", c.rig.depth.value_or(DepthCalibration{}).noise_m, report);
}

}  // namespace apvi::doctor
