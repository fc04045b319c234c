// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "sim/scene_config.hpp"
#include "sim/writers/dataset_writer.hpp"

namespace apvi::sim {

struct SimulateOptions {
  OutputFormat format = OutputFormat::folder;
  int threads = 1;
};

enum class SimulateResult { written, already_complete };

/// Simulates a scene into the folder `out`. All files are written to `out` + ".partial", which is
/// renamed when it is complete. An interrupted simulation resumes when it is started again with the
/// same scene. The output depends only on the scene, not on `threads` or interruptions.
///
/// Throws InputError when the folder cannot be created, when `out` exists and is not the finished
/// dataset of the same scene, when `out`.partial belongs to another scene, or when the path is
/// invalid; RunError when a file cannot be written or the user interrupts.
SimulateResult simulate(const Scene& scene, const std::filesystem::path& out,
                        const SimulateOptions& options);

}  // namespace apvi::sim
