// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "runs/live/live_hooks.hpp"
#include "runs/run_config.hpp"
#include "runs/run_observer.hpp"

namespace apvi::runs {

struct MappingRunOptions {
  std::filesystem::path folder;
  bool overwrite = false;
  bool resume = false;  ///< from the folder's checkpoint.pt, if it exists
  std::function<bool()> interrupted = [] { return false; };  ///< polled after every iteration
  const LiveHooks* live = nullptr;                           ///< see RunOptions
  RunObserver* observer = nullptr;                           ///< of a run with localization
};

struct MappingRunResult {
  bool interrupted = false;
  std::int64_t iterations = 0;
  std::int64_t gaussians = 0;
  double wall_s = 0.0;   ///< training time
  double psnr_db = 0.0;  ///< of the held-out images; NaN when there are none
};

/// Builds a map of a recording with given poses, into a run folder: map.ply, medium.json (with a
/// medium), keyframes.tum, metrics.json, mapping.csv (held-out PSNR over time), renders/ (held-out
/// images: truth, render, restored, depth), resolved.yaml, log.txt, checkpoint.pt. Results so far
/// are in the folder even when this is interrupted. Throws InputError for a bad recording,
/// configuration or checkpoint, RunError when something cannot be written.
MappingRunResult run_mapping(const RunConfig& config, const MappingRunOptions& options);

}  // namespace apvi::runs
