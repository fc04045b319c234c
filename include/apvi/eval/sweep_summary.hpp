// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "apvi/eval/metrics_file.hpp"

namespace apvi::eval {

/// A case of a sweep and what became of it.
struct SweepRow {
  enum class State { open, done, failed };

  std::string group;  ///< the same for all seeds of a case
  std::vector<std::pair<std::string, std::string>> choices;
  std::optional<int> seed;
  State state = State::open;
  std::string reason;                                   ///< of a failure
  std::vector<std::pair<std::string, double>> metrics;  ///< by dotted name, in the file's order
};
std::string_view to_string(SweepRow::State state);

/// The numbers of a metrics file by dotted name; booleans count as 0 and 1, of a list of numbers
/// there are `.mean` and `.max`, unless it is empty.
std::vector<std::pair<std::string, double>> flatten(const Json& metrics);

/// Every case a line: group, seed, state, reason, choices, all metrics (empty: not applicable).
std::string sweep_csv(const std::vector<SweepRow>& rows);

/// Every group a line in Markdown: choices, finished of all, and mean ± sample standard deviation
/// over the seeds of each column, with the number of seeds where not all that finished have it;
/// then the failures with their reasons. `columns` empty: the usual ones, as far as any case has
/// them.
std::string sweep_table(const std::vector<SweepRow>& rows, std::vector<std::string> columns);

}  // namespace apvi::eval
