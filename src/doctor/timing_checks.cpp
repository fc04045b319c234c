// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "doctor/checks.hpp"

namespace apvi::doctor {
namespace {

constexpr double kRateNoteFraction = 0.02;
constexpr double kRateWarningFraction = 0.1;
constexpr double kGapOfMedian = 4.0;
constexpr double kRepeatedShare = 0.05;
constexpr double kMaxStartDelay = 5.0;  // [s]

struct Sensor {
  std::string name;
  std::string stream;  // key of the reader's report
  const Timing* timing;
  bool in_rig;
  double nominal_hz;  // zero: not in the rig
  double bad_gap_s;   // longer gaps are warnings
  bool repeats_matter;
};

std::vector<Sensor> sensors_of(const CheckInput& c) {
  const Rig& rig = c.rig;
  const auto camera_rate = [&rig](std::size_t i) {
    return rig.cameras.size() > i ? rig.cameras[i].rate_hz : 0.0;
  };
  return {{"imu0", "imu", &c.observed.imu.timing, rig.imu.has_value(),
           rig.imu ? rig.imu->rate_hz : 0.0, 0.1, true},
          {"dvl0", "dvl", &c.observed.dvl.timing, rig.dvl.has_value(), 0.0, 5.0, true},
          {"pressure0", "pressure", &c.observed.pressure.timing, rig.pressure.has_value(), 0.0, 5.0,
           false},
          {"depth0", "depth", &c.observed.depth.timing, rig.depth.has_value(), 0.0, 5.0, false},
          {"cam0", "camera", &c.observed.cameras[0].timing, !rig.cameras.empty(), camera_rate(0),
           1.0, false},
          {"cam1", "camera", &c.observed.cameras[1].timing, rig.cameras.size() > 1, camera_rate(1),
           1.0, false},
          {"gnss0", "gnss", &c.observed.gnss, true, 0.0, 60.0, false}};
}

std::string_view section_of(const Sensor& s) {
  return s.name;
}

std::string remark_of(const CheckInput& c, const Sensor& s) {
  const auto stream = c.observed.streams.find(s.stream);
  return stream == c.observed.streams.end() ? "" : stream->second.remark;
}

// What the reader says of a sensor: the advice follows the last semicolon. It leaves out a sensor
// with another clock than the IMU.
void check_remark(const CheckInput& c, const Sensor& s, Report& report) {
  const std::string remark = remark_of(c, s);
  if (remark.empty()) return;
  const std::size_t cut = remark.rfind("; ");
  const bool is_left_out = s.timing->count == 0;
  report.add({is_left_out ? Severity::error : Severity::warning,
              s.name,
              is_left_out ? "common time" : "reading",
              remark.substr(0, cut),
              cut == std::string::npos ? "" : remark.substr(cut + 2),
              {{"samples", static_cast<double>(s.timing->count)}}});
}

void check_presence(const CheckInput& c, const Sensor& s, Report& report) {
  const auto stream = c.observed.streams.find(s.stream);
  const bool opened = stream != c.observed.streams.end() && s.name != "cam1";
  const bool claimed = c.has_rig && s.in_rig && s.name != "gnss0";
  if (s.timing->count > 0) {
    if (!c.has_rig || s.in_rig) return;
    report.add(
        {Severity::warning,
         s.name,
         "rig",
         fmt::format("reports {} samples, but the rig does not describe it", s.timing->count),
         fmt::format("add a {} section to rig.yaml; otherwise it is not used", section_of(s)),
         {}});
  } else if ((opened || claimed) && remark_of(c, s).empty()) {
    report.add({claimed ? Severity::error : Severity::warning,
                s.name,
                "presence",
                opened ? "never reports: its file or topic holds no usable sample"
                       : "never reports, but the rig describes it",
                fmt::format("record it, or remove {} from the rig and from sensors.use", s.name),
                {{"samples", 0.0}}});
  }
}

void check_rate(const Sensor& s, Report& report) {
  const Timing& t = *s.timing;
  const double mean = t.span_s() > 0.0 ? static_cast<double>(t.count - 1) / t.span_s() : 0.0;
  Finding f{Severity::ok, s.name, "rate", "", "", {{"median_hz", t.rate_hz()}, {"mean_hz", mean}}};
  f.message = fmt::format("{:.4g} Hz", t.rate_hz());
  if (std::abs(mean - t.rate_hz()) > 0.05 * t.rate_hz()) {
    f.message += fmt::format(" by the median step, {:.4g} Hz on average", mean);
  }
  f.message += fmt::format("; {} samples over {:.1f} s", t.count, t.span_s());
  if (s.nominal_hz > 0.0) {
    // With jitter the mean rate matches the nominal one, with gaps the median rate.
    const double off =
        std::min(std::abs(t.rate_hz() / s.nominal_hz - 1.0), std::abs(mean / s.nominal_hz - 1.0));
    f.message += fmt::format("; nominal {:.4g} Hz", s.nominal_hz);
    if (off > kRateNoteFraction) {
      f.severity = off > kRateWarningFraction ? Severity::warning : Severity::note;
      f.advice = fmt::format(
          "set {}.rate_hz in the rig to the measured rate, or look for lost samples", s.name);
    }
  }
  report.add(std::move(f));
}

void check_gaps(const Sensor& s, Report& report) {
  const Timing& t = *s.timing;
  const double median = t.steps.median();
  const double longest = t.longest_step;
  Finding f{Severity::ok, s.name, "gaps", "", "", {{"longest_s", longest}}};
  const double at = seconds_between(t.first, t.longest_at);
  f.message = fmt::format("longest step {:.3g} s, at {:.1f} s", longest, at);
  if (longest <= kGapOfMedian * median) {
    f.message = fmt::format("none; longest step {:.3g} s", longest);
  } else {
    const double share = t.steps.fraction_at_least(kGapOfMedian * median);
    f.values.emplace_back("share", share);
    f.message += fmt::format("; {:.2g} % of the steps are over {:.0f} times the median",
                             100.0 * share, kGapOfMedian);
    f.severity = longest > s.bad_gap_s ? Severity::warning : Severity::note;
    if (f.severity == Severity::warning) {
      f.advice =
          s.name == "imu0"
              ? "motion in the gap is lost: look for an overloaded logger or a loose cable"
              : "the estimate drifts in the gap: look for an overloaded logger or a lost link";
    }
  }
  report.add(std::move(f));
}

void check_jitter(const Sensor& s, Report& report) {
  const Timing& t = *s.timing;
  const double low = t.steps.quantile(0.05);
  const double high = t.steps.quantile(0.95);
  const double median = t.steps.median();
  if (t.count < 20 || !(median > 0.0)) return;
  const double spread = (high - low) / median;
  Finding f{
      Severity::ok, s.name,
      "jitter",     fmt::format("90 % of the steps are between {:.3g} and {:.3g} s", low, high),
      "",           {{"low_s", low}, {"high_s", high}}};
  if (spread > 0.5) {
    f.severity = Severity::note;
    f.advice = "these look like arrival times; use the device's own stamps";
  }
  report.add(std::move(f));
}

void check_repeats(const Sensor& s, Report& report) {
  const Timing& t = *s.timing;
  const double share = static_cast<double>(t.repeated) / static_cast<double>(t.count);
  if (!s.repeats_matter || t.count < 20 || share < kRepeatedShare) return;
  const double fresh =
      t.span_s() > 0.0 ? static_cast<double>(t.count - t.repeated) / t.span_s() : 0.0;
  const bool frozen = t.repeated + 1 == t.count;
  Finding f{frozen ? Severity::error : Severity::warning, s.name, "repeats", "", "",
            {{"share", share}, {"fresh_hz", fresh}}};
  f.message = frozen ? "all samples are identical"
                     : fmt::format(
                           "{:.1f} % of the samples repeat the previous one exactly; new ones "
                           "arrive at {:.3g} Hz",
                           100.0 * share, fresh);
  f.advice = frozen ? "the device or its driver hangs"
                    : "log each measurement once: repeats would count as independent measurements";
  report.add(std::move(f));
}

void check_drops(const Sensor& s, const io::StreamReport& stream, Report& report) {
  std::size_t dropped = 0;
  for (const auto& [reason, count] : stream.dropped) dropped += count;
  for (const auto& [reason, count] : stream.dropped) {
    if (count == 0) continue;
    const bool most = 2 * count > stream.delivered + dropped;
    const auto where = stream.first_drop.find(reason);
    Finding f{most ? Severity::error : Severity::warning,
              s.name,
              std::string(io::to_string(reason)),
              "",
              "",
              {{"dropped", static_cast<double>(count)}}};
    f.message = fmt::format("{} of {} samples are invalid", count, stream.delivered + dropped);
    if (where != stream.first_drop.end()) f.message += ", first at " + where->second;
    f.advice = "they are skipped when reading";
    if (reason == io::DropReason::out_of_order || reason == io::DropReason::broken_stamp) {
      f.advice += "; was a clock changed while recording?";
    }
    report.add(std::move(f));
  }
}

// Both cameras share one stream report of the reader.
bool owns_stream(const CheckInput& c, const Sensor& s) {
  if (s.name == "cam1") return false;
  return c.observed.streams.count(s.stream) > 0;
}

void check_common_time(const CheckInput& c, const Sensor& s, Report& report) {
  const Timing& imu = c.observed.imu.timing;
  const Timing& t = *s.timing;
  if (s.name == "imu0" || imu.count == 0 || t.count == 0) return;
  const double late = seconds_between(imu.first, t.first);
  const double early = seconds_between(t.last, imu.last);
  if (t.last < imu.first || t.first > imu.last) {
    const double apart =
        std::max(seconds_between(t.last, imu.first), seconds_between(imu.last, t.first));
    report.add({Severity::error,
                s.name,
                "common time",
                fmt::format("no time overlap with imu0; they are {:.1f} s apart", apart),
                "do both use the same clock?",
                {{"apart_s", apart}}});
  } else if (late > kMaxStartDelay || early > kMaxStartDelay) {
    report.add({Severity::note,
                s.name,
                "common time",
                fmt::format("begins {:.1f} s after imu0 and ends {:.1f} s before it", late, early),
                "",
                {{"late_s", late}, {"early_s", early}}});
  }
}

}  // namespace

void check_timing(const CheckInput& c, Report& report) {
  for (const Sensor& s : sensors_of(c)) {
    check_presence(c, s, report);
    if (s.name != "cam1") check_remark(c, s, report);
    if (owns_stream(c, s)) check_drops(s, c.observed.streams.at(s.stream), report);
    if (s.timing->count == 0) continue;
    check_common_time(c, s, report);
    if (s.timing->count < 2) {
      report.add({Severity::warning, s.name, "rate", "only one sample", "record longer", {}});
      continue;
    }
    check_rate(s, report);
    check_gaps(s, report);
    check_jitter(s, report);
    check_repeats(s, report);
  }
}

}  // namespace apvi::doctor
