// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "io/sample_source.hpp"

namespace apvi::io {

/// From the first to the last stamp of a sensor [s].
struct ClockSpan {
  double first_s = 0.0;
  double last_s = 0.0;

  double length_s() const { return last_s - first_s; }
};

/// nullopt where it is not known before the samples are read.
std::optional<ClockSpan> span_of(const std::optional<StampSummary>& stamps);

/// Whether two sensors have no time in common, and more than `gap_s` lies between them.
bool are_apart(const ClockSpan& a, const ClockSpan& b, double gap_s);

/// That a sensor of this kind has another clock than the IMU: both spans, and what to do. Starts
/// are not aligned without a word, as they agree to a second at best.
std::string describe_clocks(const std::string& kind, const ClockSpan& span, const ClockSpan& imu);
/// The same when only the first stamps are known [s].
std::string describe_clocks(const std::string& kind, double first_s, double imu_first_s);

}  // namespace apvi::io
