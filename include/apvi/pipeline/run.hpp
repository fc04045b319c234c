// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>

#include "apvi/eval/metrics_file.hpp"
#include "apvi/pipeline/map_sink.hpp"
#include "apvi/pipeline/run_config.hpp"

namespace apvi::pipeline {

struct RunOptions {
  std::filesystem::path folder;
  bool overwrite = false;
  std::function<bool()> interrupted = [] { return false; };  ///< asked after every sample
  /// What resolved.yaml says; more than this configuration when it is part of a larger one.
  std::function<config::Node(const RunConfig&)> describe = [](const RunConfig& used) {
    return config::to_node(used);
  };
  MapSink* map = nullptr;  ///< gets what a map is made of, when the run has a camera
};

struct RunResult {
  bool interrupted = false;
  std::size_t poses = 0;
  double sequence_s = 0.0;  ///< span of the samples that were read
  double wall_s = 0.0;      ///< time it took
  eval::RunTrajectories metrics;
};

/// Runs localization over a recording into a run folder and evaluates it against the recording's
/// reference, if there is one. What was computed is in the folder even when this throws. Throws
/// InputError for a bad recording or configuration, RunError when nothing could be estimated or
/// written.
RunResult run(const RunConfig& config, const RunOptions& options);
/// The same over any sequence, one that is fed while it is read too; `dataset` is not looked at.
RunResult run(const RunConfig& config, io::SequenceReader& reader, const RunOptions& options);

}  // namespace apvi::pipeline
