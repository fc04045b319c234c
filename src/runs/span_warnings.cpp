// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "apvi/core/log.hpp"
#include "io/clock_spans.hpp"
#include "runs/warnings.hpp"

namespace apvi::runs {
namespace {

using Warnings = std::vector<std::string>;
using Spans = std::map<std::string, SampleSpan>;

// Between the recordings of two sensors, which drivers start and stop within seconds [s].
constexpr double kMaxDelay_s = 5.0;

// Drivers that are started together report within this time [s].
constexpr double kLateStart_s = 2.0;
// Estimators that have all they need begin within this time, also by images [s].
constexpr double kLatePoses_s = 10.0;

// A sensor must report during this part of a recording that is at least so long [s].
constexpr double kMinCovered = 0.5;
constexpr double kMinRecording_s = 10.0;

io::ClockSpan clock_span(const SampleSpan& span) {
  return {span.first.seconds(), span.last.seconds()};
}

// Of the same length of recording, but shifted.
void check_delay(const SampleStatistics& samples, Warnings& warnings) {
  const double delay = samples.dvl_delay_s();
  if (std::abs(delay) <= kMaxDelay_s) return;
  warnings.push_back(fmt::format(
      "dvl: begins and ends {:.1f} s {} the IMU: check whether both use the same clock, "
      "and shift the stamps of one (dataset.clock_shift_s.dvl)",
      std::abs(delay), delay > 0.0 ? "after" : "before"));
}

void check_start(const std::string& kind, const SampleSpan& span, Stamp begin,
                 const Trajectory& fused, Warnings& warnings) {
  const double late_s = seconds_between(begin, span.first);
  if (late_s < kLateStart_s) return;
  const double poses_s = fused.empty() ? 0.0 : seconds_between(begin, fused.poses.front().stamp);
  const std::string result =
      fused.empty() ? "there are no poses"
      : poses_s >= late_s
          ? fmt::format("poses begin at {:.1f} s", poses_s)
          : fmt::format("poses begin at {:.1f} s, the first of them without it", poses_s);
  warnings.push_back(
      fmt::format("{}: begins {:.1f} s after the recording: {}", kind, late_s, result));
}

void check_first_pose(Stamp begin, const Trajectory& fused, Warnings& warnings) {
  if (fused.empty()) return;
  const double poses_s = seconds_between(begin, fused.poses.front().stamp);
  if (poses_s < kLatePoses_s) return;
  warnings.push_back(fmt::format(
      "trajectory: begins {:.1f} s after the recording, as the sensors gave no pose before: no "
      "bottom lock, or images without motion or structure",
      poses_s));
}

}  // namespace

std::vector<std::string> check_spans(const SampleStatistics& samples, const Trajectory& fused) {
  Warnings warnings;
  const Spans& spans = samples.spans();
  const auto imu = spans.find("imu");
  double longest_s = 0.0;
  for (const auto& [kind, span] : spans) longest_s = std::max(longest_s, span.length_s());
  const auto is_apart = [&](const SampleSpan& span) {
    return imu != spans.end() && are_apart(clock_span(span), clock_span(imu->second), 0.0);
  };
  const bool one_clock = std::ranges::none_of(
      spans, [&](const auto& entry) { return entry.first != "gnss" && is_apart(entry.second); });
  if (one_clock) check_delay(samples, warnings);
  const std::size_t before = warnings.size();
  const bool starts_agree = one_clock && before == 0;  // else the delay has been named
  for (const auto& [kind, span] : spans) {
    if (kind == "gnss") continue;  // at the surface only
    if (is_apart(span)) {
      warnings.push_back(describe_clocks(kind, clock_span(span), clock_span(imu->second)));
      continue;
    }
    if (longest_s >= kMinRecording_s && span.length_s() < kMinCovered * longest_s) {
      warnings.push_back(
          fmt::format("{}: its {} samples cover {:.1f} of {:.1f} s; the rest is without it", kind,
                      span.count, span.length_s(), longest_s));
    }
    if (starts_agree) check_start(kind, span, *samples.first(), fused, warnings);
  }
  if (one_clock && warnings.size() == before) {
    check_first_pose(*samples.first(), fused, warnings);
  }
  return warnings;
}

}  // namespace apvi::runs
