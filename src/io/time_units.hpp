// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/sample_source.hpp"

namespace apvi::io {

/// A unit of stamps that is not the one that a file names, or seemed to have.
struct TimeUnitChange {
  int power = 0;       ///< of ten nanoseconds
  std::string remark;  ///< what contradicts the file, and what to do
};

/// The stamps of one sensor of a recording; nullopt where their unit is beyond doubt.
struct SensorStamps {
  std::string kind;
  std::optional<StampSummary> stamps;
};

/// Decides the unit of every sensor's stamps, in the order given; nullopt: it stays.
///
/// - The rate of the samples is impossible for the kind of sensor, and usual in one other unit.
/// - The rate is unusual, and in the unit in which it is usual the stamps are times since 1970.
/// - The stamps lie apart from those of the other sensors, or cover a tiny part of them, and fit
///   them in one other unit.
std::vector<std::optional<TimeUnitChange>> decide_time_units(std::vector<SensorStamps> sensors);

/// What is known of the stamps of a source before its first sample is read.
struct SettledStamps {
  std::string remark;                  ///< that their unit was changed, or rows sorted; else ""
  std::optional<StampSummary> stamps;  ///< in the unit that counts
};
/// Applies `decide_time_units` to the sources, with a warning for each change. Returns what is
/// known, by source. To be called before the first sample is read.
std::vector<SettledStamps> settle_time_units(const Recording& recording);

}  // namespace apvi::io
