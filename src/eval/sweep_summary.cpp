// SPDX-License-Identifier: BSD-3-Clause
#include "eval/sweep_summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

namespace apvi::eval {
namespace {

using State = SweepRow::State;

const std::vector<std::string> kDefaultColumns{"trajectory.ate_rmse_m",
                                               "trajectory.ate_percent_of_path",
                                               "trajectory.rpe_10m_rmse_m",
                                               "trajectory.coverage",
                                               "trajectory.dipo.ate_rmse_m",
                                               "trajectory.vio.ate_rmse_m",
                                               "vio.failures",
                                               "mapping.psnr_db",
                                               "mapping.ssim",
                                               "mapping.lpips",
                                               "mapping.depth_rmse_m",
                                               "medium.error_percent",
                                               "speed.realtime_factor"};

// Adds mean and maximum of a list of numbers.
void add_list(const Json& list, const std::string& name,
              std::vector<std::pair<std::string, double>>& numbers) {
  const auto is_number = [](const Json& value) { return value.is_number(); };
  if (list.empty() || !std::all_of(list.begin(), list.end(), is_number)) return;
  const auto values = list.get<std::vector<double>>();
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  numbers.emplace_back(name + ".mean", sum / static_cast<double>(values.size()));
  numbers.emplace_back(name + ".max", *std::max_element(values.begin(), values.end()));
}

void add_numbers(const Json& json, const std::string& path,
                 std::vector<std::pair<std::string, double>>& numbers) {
  for (const auto& [key, value] : json.items()) {
    const std::string name = path.empty() ? key : fmt::format("{}.{}", path, key);
    if (value.is_object()) {
      add_numbers(value, name, numbers);
    } else if (value.is_boolean()) {
      numbers.emplace_back(name, value.get<bool>() ? 1.0 : 0.0);
    } else if (value.is_number()) {
      numbers.emplace_back(name, value.get<double>());
    } else if (value.is_array()) {
      add_list(value, name, numbers);
    }
  }
}

std::optional<double> find(const SweepRow& row, const std::string& name) {
  for (const auto& [key, value] : row.metrics) {
    if (key == name) return value;
  }
  return std::nullopt;
}

template <typename Names>
void add_new(std::vector<std::string>& names, const Names& pairs) {
  for (const auto& [name, value] : pairs) {
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
}

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::string choice(const SweepRow& row, const std::string& axis) {
  for (const auto& [name, label] : row.choices) {
    if (name == axis) return label;
  }
  return "";
}

// Escapes vertical bars.
std::string markdown_cell(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) {
    text.insert(at, "\\");
  }
  return text;
}

std::string mean_and_spread(const std::vector<double>& values, std::size_t finished) {
  if (values.empty()) return "";
  const double n = static_cast<double>(values.size());
  double sum = 0.0;
  for (const double value : values) sum += value;
  const double mean = sum / n;
  double squares = 0.0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  std::string text = fmt::format("{:.4g}", mean);
  if (values.size() > 1) text += fmt::format(" ± {:.2g}", std::sqrt(squares / (n - 1.0)));
  if (values.size() < finished) text += fmt::format(" ({})", values.size());
  return text;
}

std::string group_line(const std::vector<const SweepRow*>& rows,
                       const std::vector<std::string>& axes,
                       const std::vector<std::string>& columns) {
  std::string line = "|";
  for (const std::string& axis : axes) {
    line += fmt::format(" {} |", markdown_cell(choice(*rows.front(), axis)));
  }
  if (axes.empty()) line += fmt::format(" {} |", markdown_cell(rows.front()->group));
  const auto done = static_cast<std::size_t>(
      std::count_if(rows.begin(), rows.end(), [](auto row) { return row->state == State::done; }));
  line += fmt::format(" {}/{} |", done, rows.size());
  for (const std::string& column : columns) {
    std::vector<double> values;
    for (const SweepRow* row : rows) {
      const std::optional<double> value = find(*row, column);
      if (row->state == State::done && value) values.push_back(*value);
    }
    line += fmt::format(" {} |", mean_and_spread(values, done));
  }
  return line + "\n";
}

std::string header(const std::vector<std::string>& axes, const std::vector<std::string>& columns) {
  std::vector<std::string> names = axes;
  if (names.empty()) names.emplace_back("sweep");
  names.emplace_back("finished");
  names.insert(names.end(), columns.begin(), columns.end());
  std::string line = "|";
  std::string rule = "|";
  for (const std::string& name : names) {
    line += fmt::format(" {} |", markdown_cell(name));
    rule += "---|";
  }
  return line + "\n" + rule + "\n";
}

std::string failures(const std::vector<SweepRow>& rows) {
  std::string text;
  for (const SweepRow& row : rows) {
    if (row.state != State::failed) continue;
    const std::string seed = row.seed ? fmt::format(", seed {}", *row.seed) : "";
    text += fmt::format("* {}{}: {}\n", row.group, seed, row.reason);
  }
  return text.empty() ? "" : "\nFailed:\n\n" + text;
}

}  // namespace

std::string_view to_string(State state) {
  switch (state) {
    case State::open:
      return "open";
    case State::done:
      return "done";
    case State::failed:
      return "failed";
  }
  return "";
}

std::vector<std::pair<std::string, double>> flatten(const Json& metrics) {
  std::vector<std::pair<std::string, double>> numbers;
  add_numbers(metrics, "", numbers);
  return numbers;
}

std::string sweep_csv(const std::vector<SweepRow>& rows) {
  std::vector<std::string> axes;
  std::vector<std::string> metrics;
  for (const SweepRow& row : rows) {
    add_new(axes, row.choices);
    add_new(metrics, row.metrics);
  }
  std::string csv = "group,seed,state,reason";
  for (const std::string& name : axes) csv += "," + csv_field(name);
  for (const std::string& name : metrics) csv += "," + csv_field(name);
  csv += "\n";
  for (const SweepRow& row : rows) {
    csv +=
        fmt::format("{},{},{},{}", csv_field(row.group), row.seed ? std::to_string(*row.seed) : "",
                    to_string(row.state), csv_field(row.reason));
    for (const std::string& axis : axes) csv += "," + csv_field(choice(row, axis));
    for (const std::string& name : metrics) {
      const std::optional<double> value = find(row, name);
      csv += value ? fmt::format(",{}", *value) : ",";
    }
    csv += "\n";
  }
  return csv;
}

std::string sweep_table(const std::vector<SweepRow>& rows, std::vector<std::string> columns) {
  std::vector<std::string> axes;
  std::vector<std::pair<std::string, std::vector<const SweepRow*>>> groups;
  for (const SweepRow& row : rows) {
    add_new(axes, row.choices);
    const auto it = std::find_if(groups.begin(), groups.end(),
                                 [&](const auto& group) { return group.first == row.group; });
    if (it == groups.end()) {
      groups.push_back({row.group, {&row}});
    } else {
      it->second.push_back(&row);
    }
  }
  if (columns.empty()) {
    for (const std::string& name : kDefaultColumns) {
      const bool known = std::any_of(rows.begin(), rows.end(), [&](const SweepRow& row) {
        return find(row, name).has_value();
      });
      if (known) columns.push_back(name);
    }
  }
  std::string table = header(axes, columns);
  for (const auto& [group, members] : groups) table += group_line(members, axes, columns);
  return table + failures(rows);
}

}  // namespace apvi::eval
