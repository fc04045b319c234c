// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace apvi::doctor {

/// ok: no problem. note: worth knowing, no action required. warning: degrades results. error: makes
/// estimation impossible.
enum class Severity { ok, note, warning, error };
std::string_view to_string(Severity severity);

/// Result of one check.
struct Finding {
  Severity severity = Severity::ok;
  std::string sensor;   ///< "imu0", "dvl0", ..., "rig", "recording"
  std::string check;    ///< short name of the check, unique per sensor
  std::string message;  ///< measured result, with number and unit
  std::string advice;   ///< recommended action; empty when none
  std::vector<std::pair<std::string, double>> values;  ///< machine-readable; names include the unit
};

struct Report {
  std::string dataset;
  std::vector<Finding> findings;

  void add(Finding finding) { findings.push_back(std::move(finding)); }
  std::size_t count(Severity severity) const;
  bool has_error(std::string_view sensor) const;
  /// First finding of this sensor and check; null when there is none.
  const Finding* find(std::string_view sensor, std::string_view check) const;
};

/// Aligned text, grouped by sensor, with the counts in the last line.
std::string to_text(const Report& report);
/// JSON object: dataset, errors, warnings, findings. Non-finite values become null.
std::string to_json(const Report& report);

}  // namespace apvi::doctor
