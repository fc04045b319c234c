// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kLowValidFraction = 0.5;
constexpr double kHighValidFraction = 0.9;
constexpr double kLongDropout = 5.0;  // [s]
constexpr double kMaxZeroFraction = 0.01;
constexpr double kNoSolution = 2.6;  // devices report 2.66, 2.71, 10 or 17.49 m/s for "none"

void check_validity(const DvlObservations& dvl, Report& report) {
  const double share = static_cast<double>(dvl.valid) / static_cast<double>(dvl.timing.count);
  Finding f{Severity::ok,
            "dvl0",
            "validity",
            fmt::format("{:.1f} % of {} pings have bottom lock", 100.0 * share, dvl.timing.count),
            "",
            {{"share", share}}};
  if (dvl.valid == 0) {
    f.severity = Severity::error;
    f.advice = "check that it was in the water, within bottom range, and switched on";
  } else if (share < kHighValidFraction) {
    f.severity = share < kLowValidFraction ? Severity::warning : Severity::note;
    f.advice = "check altitude and range mode; invalid pings are not used";
  }
  report.add(std::move(f));
}

void check_dropouts(const DvlObservations& dvl, Report& report) {
  if (!dvl.last_valid) return;
  const double to_end = seconds_between(*dvl.last_valid, dvl.timing.last);
  const bool at_end = to_end > dvl.longest_dropout;
  const double longest = std::max(to_end, dvl.longest_dropout);
  const Stamp since = at_end ? *dvl.last_valid : dvl.dropout_at;
  Finding f{Severity::ok,
            "dvl0",
            "dropouts",
            fmt::format("longest time without bottom lock {:.3g} s, from {:.1f} s on", longest,
                        seconds_between(dvl.timing.first, since)),
            "",
            {{"longest_s", longest}}};
  if (longest > kLongDropout) {
    f.severity = Severity::warning;
    f.advice = "expect position drift there, with the IMU alone";
  }
  report.add(std::move(f));
}

void check_zeros(const DvlObservations& dvl, Report& report) {
  const double share = static_cast<double>(dvl.zero) / static_cast<double>(dvl.valid);
  if (share < kMaxZeroFraction) return;
  report.add({Severity::warning,
              "dvl0",
              "zeros",
              fmt::format("{} pings ({:.1f} %) are valid and exactly zero on all axes", dvl.zero,
                          100.0 * share),
              "some drivers report zeros without bottom lock: mark those pings invalid",
              {{"share", share}}});
}

void check_speed(const DvlObservations& dvl, Report& report) {
  const double median = dvl.speed.median();
  const double highest = dvl.speed.quantile(0.99);
  Finding f{Severity::ok, "dvl0",
            "speed",      fmt::format("median {:.3g} m/s, 99 % below {:.3g} m/s", median, highest),
            "",           {{"median_m_s", median}, {"p99_m_s", highest}}};
  if (median > kMaxVehicleSpeed) {
    f.severity = Severity::error;
    f.advice = "too fast for any vehicle: are these mm/s or cm/s?";
  } else if (highest > kMaxVehicleSpeed) {
    f.severity = Severity::warning;
    f.advice = "some pings are outliers; outlier rejection must handle them";
  }
  report.add(std::move(f));
}

// Pings faster than any DVL measures count as invalid. If most are, the unit is wrong; placeholders
// repeat.
void check_excessive_speed(const DvlObservations& dvl, Report& report) {
  const LogHistogram& speed = dvl.excessive_speed;
  if (2 * speed.count() < dvl.timing.count) return;
  report.add({Severity::error,
              "dvl0",
              "speed",
              fmt::format("median {:.3g} m/s of the invalid pings", speed.median()),
              "too fast for any vehicle: are these mm/s or cm/s?",
              {{"median_m_s", speed.median()}}});
}

void check_figure_of_merit(const DvlObservations& dvl, Report& report) {
  const LogHistogram& fom = dvl.figure_of_merit;
  if (fom.count() == 0) return;
  const double none = fom.fraction_at_least(kNoSolution);
  Finding f{
      Severity::ok,
      "dvl0",
      "figure of merit",
      fmt::format("median {:.3g} m/s, 95 % below {:.3g} m/s", fom.median(), fom.quantile(0.95)),
      "",
      {{"median_m_s", fom.median()}, {"no_solution_share", none}}};
  if (none > 0.0) {
    f.severity = Severity::note;
    f.message += fmt::format("; {:.2g} % of the pings report {} or more, which means no solution",
                             100.0 * none, kNoSolution);
    f.advice =
        "rely on validity and innovations: this value differs by a factor of 30 between firmwares";
  }
  report.add(std::move(f));
}

void check_beam_share(const DvlObservations& dvl, Report& report) {
  if (dvl.with_beams == 0) return;
  const double share = static_cast<double>(dvl.four_beams) / static_cast<double>(dvl.with_beams);
  report.add({share < kLowValidFraction ? Severity::note : Severity::ok,
              "dvl0",
              "beams",
              fmt::format("all four valid in {:.1f} % of the valid pings", 100.0 * share),
              "",
              {{"four_share", share}}});
}

}  // namespace

void check_dvl(const CheckInput& c, Report& report) {
  const DvlObservations& dvl = c.observed.dvl;
  if (dvl.timing.count == 0) return;
  check_validity(dvl, report);
  check_excessive_speed(dvl, report);
  if (dvl.valid == 0) return;
  check_dropouts(dvl, report);
  check_zeros(dvl, report);
  check_speed(dvl, report);
  check_figure_of_merit(dvl, report);
  check_beam_share(dvl, report);
}

}  // namespace apvi::doctor
