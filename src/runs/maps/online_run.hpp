// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "runs/maps/mapping_run.hpp"
#include "runs/run.hpp"

namespace apvi::runs {

struct OnlineRunResult {
  std::optional<RunResult> localization;  ///< empty when a map was only refined further
  MappingRunResult map;
};

/// Runs localization and mapping on a recording, opened with `config.sensors.use`, into one run
/// folder: the files of `run`, and map.ply, medium.json (with a medium), mapping.csv, renders/,
/// checkpoint.pt; keyframes.tum holds the keyframes of the map. With `resume` only the recording's
/// calibration is read: the map in the folder is refined further. Results so far are in the folder
/// even when this is interrupted or throws. Throws InputError and RunError as `run` and
/// `run_mapping` do.
OnlineRunResult run_online(const RunConfig& config, io::SequenceReader& recording,
                           const MappingRunOptions& options);

}  // namespace apvi::runs
