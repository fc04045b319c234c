// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/sim/dataset_writer.hpp"
#include "apvi/sim/scene_config.hpp"

namespace apvi::sim {

struct SimulateOptions {
  OutputFormat format = OutputFormat::folder;
  int threads = 1;
};

enum class Outcome { written, was_complete };

/// Simulates a scene into the folder `out`. While it works, everything is in `out` + ".partial",
/// which gets its name when it is complete: a folder that looks like a data set is one. A stopped
/// simulation goes on where it stopped when it is started again with the same scene. The bytes
/// depend on the scene alone, not on `threads` or on stops.
///
/// Throws InputError when the folder cannot be made, when `out` exists and is not the finished data
/// set of this very scene, when `out`.partial belongs to another scene, or the path is impossible;
/// RunError when a file cannot be written or the user interrupts.
Outcome simulate(const Scene& scene, const std::filesystem::path& out,
                 const SimulateOptions& options);

}  // namespace apvi::sim
