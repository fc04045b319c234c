// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "eval/metrics_file.hpp"

namespace apvi::eval {

/// A case of a sweep and its result.
struct SweepRow {
  enum class State { open, done, failed };

  std::string group;  ///< identical for all seeds of a case
  std::vector<std::pair<std::string, std::string>> choices;
  std::optional<int> seed;
  State state = State::open;
  std::string reason;                                   ///< of a failure
  std::vector<std::pair<std::string, double>> metrics;  ///< by dotted name, in the file's order
};
std::string_view to_string(SweepRow::State state);

/// The numbers of a metrics file by dotted name. Booleans become 0 and 1; a nonempty list of
/// numbers becomes `.mean` and `.max`.
std::vector<std::pair<std::string, double>> flatten(const Json& metrics);

/// CSV, one line per case: group, seed, state, reason, choices, all metrics (empty: not
/// applicable).
std::string sweep_csv(const std::vector<SweepRow>& rows);

/// Markdown table, one line per group: choices, finished cases, and mean ± sample standard
/// deviation over the seeds per column, with the number of values if some finished cases lack it;
/// then the failures with their reasons. `columns` empty: the default columns that at least one
/// case has.
std::string sweep_table(const std::vector<SweepRow>& rows, std::vector<std::string> columns);

}  // namespace apvi::eval
