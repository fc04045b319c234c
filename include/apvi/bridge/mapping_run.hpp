// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "apvi/bridge/run_config.hpp"

namespace apvi::bridge {

struct MappingRunOptions {
  std::filesystem::path folder;
  bool overwrite = false;
  bool resume = false;  ///< goes on from the folder's checkpoint.pt, if there is one
  std::function<bool()> interrupted = [] { return false; };  ///< asked after every iteration
};

struct MappingRunResult {
  bool interrupted = false;
  std::int64_t iterations = 0;
  std::int64_t gaussians = 0;
  double wall_s = 0.0;   ///< of the training
  double psnr_db = 0.0;  ///< of the held-out images; NaN when there are none
};

/// Makes a map of a recording whose poses are given, into a run folder: map.ply, medium.json (with
/// water), keyframes.tum, metrics.json, mapping.csv (held-out PSNR over time), renders/ (held-out
/// images: truth, render, restored, depth), resolved.yaml, log.txt, checkpoint.pt. What was
/// computed is in the folder even when this is interrupted. Throws InputError for a bad recording,
/// configuration or checkpoint, RunError when something cannot be written.
MappingRunResult run_mapping(const RunConfig& config, const MappingRunOptions& options);

/// The whole configuration as resolved.yaml says it, from localization's part as it was used.
config::Node describe(const RunConfig& config, const pipeline::RunConfig& as_used);

}  // namespace apvi::bridge
