// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/bridge/mapping_run.hpp"
#include "apvi/pipeline/run.hpp"

namespace apvi::bridge {

struct OnlineRunResult {
  std::optional<pipeline::RunResult> localization;  ///< nothing when a map was only refined further
  MappingRunResult map;
};

/// Localization and mapping over a recording into one run folder: what `pipeline::run` leaves
/// there, and map.ply, medium.json (with water), mapping.csv, renders/, checkpoint.pt;
/// keyframes.tum holds the keyframes that the map is made of. With `resume` the recording is not
/// looked at again: the map in the folder is refined further. What was computed is in the folder
/// even when this is interrupted or throws. Throws InputError and RunError as `pipeline::run` and
/// `run_mapping` do.
OnlineRunResult run_online(const RunConfig& config, const MappingRunOptions& options);

}  // namespace apvi::bridge
