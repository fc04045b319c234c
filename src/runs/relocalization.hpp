// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "eval/metrics_file.hpp"
#include "localization/active_sensors.hpp"
#include "localization/visual_pipeline.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// Throws InputError when the known map of a run, if it asks for one, cannot be used: before
/// anything is written to `folder`.
void check_known_map(const RunConfig& config, const localization::ActiveSensors& sensors,
                     const std::filesystem::path& folder);

/// Section `relocalization` of metrics.json: whether, when and how the dive was found in the known
/// map, and a warning when it was not. Empty for a run without a known map.
eval::Json report_relocalization(const RunConfig& config,
                                 const localization::VisualPipeline* visual,
                                 std::optional<Stamp> first, std::vector<std::string>& warnings);

}  // namespace apvi::runs
