// SPDX-License-Identifier: BSD-3-Clause
#include "io/clock_spans.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace apvi::io {
namespace {

// Recordings that are equally long within this part, and not too short, began together as a rule.
constexpr double kSameLength = 0.03;
constexpr double kMinLength_s = 10.0;

std::string key_of(const std::string& kind) {
  return "dataset.clock_shift_s." + (kind == "depth" ? "pressure" : kind);
}

std::string begin_together(const std::string& kind, double first_s, double imu_first_s) {
  return fmt::format("--set {}={:.3f}, then `apvi doctor` with the same for what is left",
                     key_of(kind), imu_first_s - first_s);
}

}  // namespace

std::optional<ClockSpan> span_of(const std::optional<StampSummary>& stamps) {
  if (!stamps) return std::nullopt;
  const double to_s = std::pow(10.0, stamps->power - 9);
  if (stamps->last < stamps->first) return std::nullopt;  // the clock was set back
  return ClockSpan{stamps->first * to_s, stamps->last * to_s};
}

bool are_apart(const ClockSpan& a, const ClockSpan& b, double gap_s) {
  return a.first_s > b.last_s + gap_s || a.last_s < b.first_s - gap_s;
}

std::string describe_clocks(const std::string& kind, const ClockSpan& span, const ClockSpan& imu) {
  const double longest_s = std::max(span.length_s(), imu.length_s());
  const double difference_s = std::abs(span.length_s() - imu.length_s());
  const bool same = longest_s >= kMinLength_s && difference_s <= kSameLength * longest_s;
  const std::string advice =
      same ? "both are equally long, so they probably began together: try " +
                 begin_together(kind, span.first_s, imu.first_s)
           : "find out by how much the clocks differ, and set " + key_of(kind);
  return fmt::format(
      "{}: none of its stamps lies within the time of the IMU: its samples are from {:.3f} to "
      "{:.3f} s, those of the IMU from {:.3f} to {:.3f} s: two clocks, so it cannot serve; {}",
      kind, span.first_s, span.last_s, imu.first_s, imu.last_s, advice);
}

std::string describe_clocks(const std::string& kind, double first_s, double imu_first_s) {
  return fmt::format(
      "{}: its first sample is at {:.3f} s, that of the IMU at {:.3f} s: two clocks, so it cannot "
      "serve; if they began together, try {}",
      kind, first_s, imu_first_s, begin_together(kind, first_s, imu_first_s));
}

}  // namespace apvi::io
