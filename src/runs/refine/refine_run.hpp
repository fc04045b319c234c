// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "runs/refine/refine_planning.hpp"

namespace apvi::runs {

struct RefineRequest {
  std::filesystem::path run;     ///< with a map
  std::filesystem::path folder;  ///< of the refined map
  RefinePlanOptions plan;
  int devices = 0;  ///< processes, one for each GPU; 0: as many as there are GPUs, or one without
  int threads = 0;  ///< of the CPU, of all processes together; 0: as the run
  std::filesystem::path program = {};  ///< apvi, which several processes run; not needed for one
  bool overwrite = false;
  bool resume = false;  ///< the refinement in the folder, with its plan
  std::function<bool()> interrupted = [] { return false; };
};

struct RefineResultSummary {
  bool interrupted = false;
  std::int64_t gaussians = 0;
  std::int64_t steps = 0;
  double wall_s = 0.0;
  double psnr_db = 0.0;       ///< of held-out images; NaN when there are none
  double psnr_before_db = 0;  ///< of the run's own map; NaN when unknown
};

/// Optimizes the map of a finished run further, block by block, by any number of processes, into
/// the run folder `folder`. The result does not depend on the number of processes, only on the
/// plan. What is done is kept when it is interrupted, or when a process or the host dies. Throws
/// InputError for a run without a map, RunError when something cannot be written or the work cannot
/// be finished.
RefineResultSummary refine_run(const RefineRequest& request);

/// Takes part in the refinement in a folder, which another process has planned, until its tasks are
/// done. Returns false when interrupted.
bool join_refinement(const std::filesystem::path& folder, int threads,
                     const std::function<bool()>& interrupted);

}  // namespace apvi::runs
