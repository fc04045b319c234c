// SPDX-License-Identifier: BSD-3-Clause
#include "eval/metrics_file.hpp"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"

namespace apvi::eval {
namespace {

void put(Json& json, const char* key, const std::optional<double>& value) {
  if (value && std::isfinite(*value)) json[key] = *value;
}

// Removes non-finite numbers, which JSON would write as null.
Json without_non_finite(const Json& json) {
  if (!json.is_object()) return json;
  Json clean = Json::object();
  for (const auto& [key, value] : json.items()) {
    if (value.is_number_float() && !std::isfinite(value.get<double>())) continue;
    clean[key] = without_non_finite(value);
  }
  return clean;
}

std::optional<double> rmse(const ErrorMetric& metric) {
  return metric.value ? std::optional(metric.value->rmse) : std::nullopt;
}

}  // namespace

Json to_json(const TrajectoryMetrics& m) {
  Json json = Json::object();
  put(json, "ate_rmse_m", rmse(m.ate));
  if (m.ate.value) {
    put(json, "ate_mean_m", m.ate.value->mean);
    put(json, "ate_median_m", m.ate.value->median);
    put(json, "ate_std_m", m.ate.value->std);
    put(json, "ate_min_m", m.ate.value->min);
    put(json, "ate_max_m", m.ate.value->max);
  }
  put(json, "ate_first_pose_rmse_m", rmse(m.ate_first_pose));
  put(json, "scale_to_reference", m.scale_to_reference);
  put(json, "ate_percent_of_path", m.ate_percent_of_path);
  put(json, "rot_rmse_deg", rmse(m.rotation_deg));
  put(json, "rpe_1s_rmse_m", rmse(m.rpe_time));
  put(json, "rpe_10m_rmse_m", rmse(m.rpe_distance));
  if (m.rpe_distance.value) {
    put(json, "rpe_10m_mean_m", m.rpe_distance.value->mean);
    put(json, "rpe_10m_median_m", m.rpe_distance.value->median);
  }
  put(json, "rpe_10m_all_pairs_rmse_m", rmse(m.rpe_distance_all_pairs));
  put(json, "coverage", m.coverage);
  put(json, "path_length_m", m.path_length_m);
  if (m.matched) json["matched"] = *m.matched;
  put(json, "end_to_start_m", m.end_to_start_m);
  put(json, "estimate_length_m", m.estimate_length_m);
  return json;
}

Json to_json(const RunTrajectories& metrics) {
  Json json = to_json(metrics.fused);
  if (metrics.dipo) json["dipo"] = to_json(*metrics.dipo);
  if (metrics.vio) json["vio"] = to_json(*metrics.vio);
  return json;
}

Json read_metrics(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) return Json::object();
  std::ifstream in(file, std::ios::binary);
  if (!in) fail_input("{}: cannot open", file.string());
  Json json = Json::parse(in, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) {
    fail_input("{}: not a JSON object; delete it and evaluate again", file.string());
  }
  return json;
}

void merge_metrics(const std::filesystem::path& file, const Json& sections) {
  Json merged = read_metrics(file);
  const Json clean = without_non_finite(sections);
  for (const auto& [key, value] : clean.items()) merged[key] = value;
  std::filesystem::path partial = file;
  partial += ".partial";
  io::write_text_file(partial, merged.dump(2) + "\n");
  std::error_code error;
  std::filesystem::rename(partial, file, error);
  if (error) fail_run("{}: cannot be written: {}", file.string(), error.message());
}

}  // namespace apvi::eval
