// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace apvi::doctor {

/// ok: measured and fine. note: worth knowing, nothing to do by itself. warning: results will
/// suffer. error: an estimator cannot work with this.
enum class Severity { ok, note, warning, error };
std::string_view to_string(Severity severity);

/// One thing that was looked at.
struct Finding {
  Severity severity = Severity::ok;
  std::string sensor;   ///< "imu0", "dvl0", ..., "rig", "recording"
  std::string check;    ///< short name of what was looked at, unique within the sensor
  std::string message;  ///< what was measured, with number and unit
  std::string advice;   ///< what to do; empty when there is nothing to do
  std::vector<std::pair<std::string, double>> values;  ///< for machines; names carry the unit
};

struct Report {
  std::string dataset;
  std::vector<Finding> findings;

  void add(Finding finding) { findings.push_back(std::move(finding)); }
  std::size_t count(Severity severity) const;
  /// The first finding of that sensor and check; null when there is none.
  const Finding* find(std::string_view sensor, std::string_view check) const;
};

/// An aligned list, grouped by sensor, and a last line with the counts.
std::string to_text(const Report& report);
/// One JSON object: dataset, errors, warnings, findings. Values that are not finite become null.
std::string to_json(const Report& report);

}  // namespace apvi::doctor
