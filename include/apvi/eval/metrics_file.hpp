// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "apvi/eval/trajectory_metrics.hpp"

namespace apvi::eval {

/// `metrics.json` of a run folder: nested objects of numbers. What is not applicable is absent,
/// never zero and never NaN.
using Json = nlohmann::ordered_json;

/// The figures of a run's trajectories; those of the estimators behind the fused one where a run
/// has them.
struct RunTrajectories {
  TrajectoryMetrics fused;
  std::optional<TrajectoryMetrics> dipo;
  std::optional<TrajectoryMetrics> vio;
};

/// ate_rmse_m, ate_first_pose_rmse_m, ate_percent_of_path, rot_rmse_deg, rpe_1s_rmse_m,
/// rpe_10m_rmse_m, coverage, path_length_m, matched, end_to_start_m, and further statistics.
Json to_json(const TrajectoryMetrics& metrics);
/// The `trajectory` section: the fused figures, with objects `dipo` and `vio` beside them.
Json to_json(const RunTrajectories& metrics);

/// The content of a metrics file; an empty object when there is none. Throws InputError with the
/// file's name when it is no JSON object.
Json read_metrics(const std::filesystem::path& file);
/// Lays `sections` over the file: each key at the top replaces the one of that name, others stay.
/// Numbers that are not finite are left out. The file is replaced in one step, so that a reader
/// never sees half of it. Throws InputError when the file is there and no JSON object, RunError
/// when it cannot be written.
void merge_metrics(const std::filesystem::path& file, const Json& sections);

/// The figures as an aligned table; an absent one says why.
std::string to_table(const RunTrajectories& metrics);

}  // namespace apvi::eval
