// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kFewValid = 0.5;
constexpr double kManyValid = 0.9;
constexpr double kLongDropout = 5.0;  // [s]
constexpr double kSomeZeros = 0.01;
constexpr double kTooFast = 15.0;    // [m/s]
constexpr double kNoSolution = 2.6;  // figures of merit that mean "none": 2.66, 2.71, 10, 17.49 m/s

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
    f.advice = "was it in the water, within range of the bottom, and switched on?";
  } else if (share < kManyValid) {
    f.severity = share < kFewValid ? Severity::warning : Severity::note;
    f.advice = "check altitude and range mode; invalid pings are not used, whatever they say";
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
    f.advice = "position drifts there with the IMU alone; expect it in the result";
  }
  report.add(std::move(f));
}

void check_zeros(const DvlObservations& dvl, Report& report) {
  const double share = static_cast<double>(dvl.zero) / static_cast<double>(dvl.valid);
  if (share < kSomeZeros) return;
  report.add({Severity::warning,
              "dvl0",
              "zeros",
              fmt::format("{} pings ({:.1f} %) are valid and exactly zero on all axes", dvl.zero,
                          100.0 * share),
              "drivers fill in zeros when there is no lock: mark those pings invalid",
              {{"share", share}}});
}

void check_speed(const DvlObservations& dvl, Report& report) {
  const double median = dvl.speed.median();
  const double highest = dvl.speed.quantile(0.99);
  Finding f{Severity::ok, "dvl0",
            "speed",      fmt::format("median {:.3g} m/s, 99 % below {:.3g} m/s", median, highest),
            "",           {{"median_m_s", median}, {"p99_m_s", highest}}};
  if (median > kTooFast) {
    f.severity = Severity::error;
    f.advice = "no vehicle is that fast: are these mm/s or cm/s?";
  } else if (highest > kTooFast) {
    f.severity = Severity::warning;
    f.advice = "some pings are outliers; the gate will have to find them";
  }
  report.add(std::move(f));
}

void check_figure_of_merit(const DvlObservations& dvl, Report& report) {
  const LogHistogram& fom = dvl.figure_of_merit;
  if (fom.count() == 0) return;
  const double none = fom.share_from(kNoSolution);
  Finding f{
      Severity::ok,
      "dvl0",
      "figure of merit",
      fmt::format("median {:.3g} m/s, 95 % below {:.3g} m/s", fom.median(), fom.quantile(0.95)),
      "",
      {{"median_m_s", fom.median()}, {"no_solution_share", none}}};
  if (none > 0.0) {
    f.severity = Severity::note;
    f.message += fmt::format("; {:.2g} % of the valid pings say {} or more, that is: no solution",
                             100.0 * none, kNoSolution);
    f.advice = "go by validity and innovations: firmwares differ thirtyfold in this figure";
  }
  report.add(std::move(f));
}

void check_beam_share(const DvlObservations& dvl, Report& report) {
  if (dvl.with_beams == 0) return;
  const double share = static_cast<double>(dvl.four_beams) / static_cast<double>(dvl.with_beams);
  report.add({share < kFewValid ? Severity::note : Severity::ok,
              "dvl0",
              "beams",
              fmt::format("all four valid in {:.1f} % of the valid pings", 100.0 * share),
              "",
              {{"four_share", share}}});
}

}  // namespace

void check_dvl(const Case& c, Report& report) {
  const DvlObservations& dvl = c.seen.dvl;
  if (dvl.timing.count == 0) return;
  check_validity(dvl, report);
  if (dvl.valid == 0) return;
  check_dropouts(dvl, report);
  check_zeros(dvl, report);
  check_speed(dvl, report);
  check_figure_of_merit(dvl, report);
  check_beam_share(dvl, report);
}

}  // namespace apvi::doctor
