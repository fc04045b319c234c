// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "eval/trajectory_metrics.hpp"

namespace apvi::eval {

/// `metrics.json` of a run folder: nested objects of numbers. Metrics that do not apply are absent,
/// never zero or NaN.
using Json = nlohmann::ordered_json;

/// Metrics of a run's fused trajectory and, if present, of the individual estimators.
struct RunTrajectories {
  TrajectoryMetrics fused;
  std::optional<TrajectoryMetrics> dipo;
  std::optional<TrajectoryMetrics> vio;
  std::optional<TrajectoryMetrics> smoothed = std::nullopt;  ///< the fused one with loops closed
  bool in_meters = true;  ///< the estimates; otherwise their unit is unknown
};

/// ate_rmse_m, ate_first_pose_rmse_m, ate_percent_of_path, rot_rmse_deg, rpe_1s_rmse_m,
/// rpe_10m_rmse_m, coverage, path_length_m, matched, end_to_start_m, and further statistics.
Json to_json(const TrajectoryMetrics& metrics);
/// The `trajectory` section: metrics of the fused trajectory, and the objects `dipo` and `vio`.
/// Those of the smoothed trajectory are a section of their own.
Json to_json(const RunTrajectories& metrics);

/// Content of a metrics file; an empty object when it does not exist. Throws InputError with the
/// file name when it is not a JSON object.
Json read_metrics(const std::filesystem::path& file);
/// Merges `sections` into the file: each top-level key replaces the existing one, others stay.
/// Non-finite numbers are omitted. The file is replaced atomically. Throws InputError when an
/// existing file is not a JSON object, RunError when it cannot be written.
void merge_metrics(const std::filesystem::path& file, const Json& sections);

/// The metrics as an aligned text table, with the reason for missing ones.
std::string to_table(const RunTrajectories& metrics);

}  // namespace apvi::eval
