// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "eval/metrics_file.hpp"
#include "localization/map_sink.hpp"
#include "runs/live/live_hooks.hpp"
#include "runs/run_config.hpp"
#include "runs/run_observer.hpp"
#include "vio/window/calibration.hpp"

namespace apvi::runs {

struct RunOptions {
  std::filesystem::path folder;
  bool overwrite = false;
  std::function<bool()> interrupted = [] { return false; };  ///< polled after every sample
  /// Called once the folder exists, before the first sample.
  std::function<void()> folder_ready = [] {};
  localization::MapSink* map = nullptr;  ///< receives map frames when the run has a camera
  const LiveHooks* live = nullptr;       ///< set for a live sequence
  RunObserver* observer = nullptr;
};

struct RunResult {
  bool interrupted = false;
  std::size_t poses = 0;
  double sequence_s = 0.0;  ///< span of the samples that were read, without pauses
  double wall_s = 0.0;      ///< processing time
  eval::RunTrajectories metrics;
  std::vector<std::string> warnings;  ///< sensors that did not serve, implausible results
  /// Of self-calibration, with "dvl0.time_offset_s" of DIPO; empty without a camera.
  vio::CalibrationEstimate calibration = {};
};

/// Runs localization on a recording into a run folder and evaluates it against the recording's
/// reference, if it has one. Results so far are in the folder even when this throws. Throws
/// InputError for a bad recording or configuration, RunError when nothing could be estimated or
/// written.
RunResult run(const RunConfig& config, const RunOptions& options);
/// The same for an opened recording or a live sequence. Of `config.dataset` only the span is used,
/// to cut the reference.
RunResult run(const RunConfig& config, io::SequenceReader& reader, const RunOptions& options);

}  // namespace apvi::runs
