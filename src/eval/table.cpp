// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "eval/metrics_file.hpp"

namespace apvi::eval {
namespace {

using Cell = std::function<std::string(const TrajectoryMetrics&)>;

Cell statistic(ErrorMetric TrajectoryMetrics::*metric, double Statistics::*which) {
  return [=](const TrajectoryMetrics& m) {
    const ErrorMetric& f = m.*metric;
    if (f.value) return fmt::format("{:.4f}", *f.value.*which);
    return m.matched ? fmt::format("- ({})", to_string(f.reason)) : std::string("-");
  };
}

template <typename T>
Cell number(std::optional<T> TrajectoryMetrics::*value, const char* format) {
  return [=](const TrajectoryMetrics& m) {
    return m.*value ? fmt::format(fmt::runtime(format), *(m.*value)) : std::string("-");
  };
}

std::vector<std::pair<std::string, Cell>> rows(bool in_meters) {
  const std::string unit = in_meters ? "[m]" : "[units]";
  using M = TrajectoryMetrics;
  return {{"ATE RMSE [m]", statistic(&M::ate, &Statistics::rmse)},
          {"ATE mean [m]", statistic(&M::ate, &Statistics::mean)},
          {"ATE median [m]", statistic(&M::ate, &Statistics::median)},
          {"ATE std [m]", statistic(&M::ate, &Statistics::std)},
          {"ATE min [m]", statistic(&M::ate, &Statistics::min)},
          {"ATE max [m]", statistic(&M::ate, &Statistics::max)},
          {"ATE, first poses equal [m]", statistic(&M::ate_first_pose, &Statistics::rmse)},
          {"ATE of path [%]", number(&M::ate_percent_of_path, "{:.3f}")},
          {"rotation RMSE [deg]", statistic(&M::rotation_deg, &Statistics::rmse)},
          {"RPE 1 s RMSE [m]", statistic(&M::rpe_time, &Statistics::rmse)},
          {"RPE 10 m RMSE [m]", statistic(&M::rpe_distance, &Statistics::rmse)},
          {"RPE 10 m, all pairs [m]", statistic(&M::rpe_distance_all_pairs, &Statistics::rmse)},
          {"coverage", number(&M::coverage, "{:.4f}")},
          {"matched poses", number(&M::matched, "{}")},
          {"path of the reference [m]", number(&M::path_length_m, "{:.2f}")},
          {"path of the estimate " + unit, number(&M::estimate_length_m, "{:.2f}")},
          {"end to start " + unit, number(&M::end_to_start_m, "{:.3f}")}};
}

}  // namespace

std::string to_table(const RunTrajectories& metrics) {
  std::vector<std::pair<std::string, const TrajectoryMetrics*>> columns;
  if (metrics.dipo || metrics.vio || metrics.smoothed)
    columns.emplace_back("fused", &metrics.fused);
  else
    columns.emplace_back("", &metrics.fused);
  if (metrics.smoothed) columns.emplace_back("smoothed", &*metrics.smoothed);
  if (metrics.dipo) columns.emplace_back("dipo", &*metrics.dipo);
  if (metrics.vio) columns.emplace_back("vio", &*metrics.vio);
  std::string table;
  const auto add_line = [&](const std::string& label, const auto& cell_of) {
    std::string line = fmt::format("{:<28}", label);
    for (const auto& [name, m] : columns) line += fmt::format(" {:>22}", cell_of(name, *m));
    table += line + "\n";
  };
  if (columns.size() > 1) add_line("", [](const std::string& name, const auto&) { return name; });
  for (const auto& row : rows(metrics.in_meters)) {
    const auto& cell = row.second;
    const bool any = std::any_of(columns.begin(), columns.end(),
                                 [&](const auto& column) { return cell(*column.second) != "-"; });
    if (!any) continue;  // without a reference most metrics do not apply
    add_line(row.first, [&](const std::string&, const TrajectoryMetrics& m) { return cell(m); });
  }
  return table;
}

}  // namespace apvi::eval
