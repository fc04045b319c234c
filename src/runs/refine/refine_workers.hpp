// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>

#include "runs/refine/refine_plan.hpp"

namespace apvi::runs {

using Interrupted = std::function<bool()>;

/// Fraction of the work of a refinement that is done, by all processes.
double refine_progress(const std::filesystem::path& folder, const RefinePlan& plan);

/// Carries out tasks of a refinement, together with other processes that do the same, until all are
/// done. A task whose process has died is done again. Returns false when interrupted. Throws what
/// `run_task` throws.
bool work(const std::filesystem::path& folder, const RefinePlan& plan,
          const Interrupted& interrupted);

struct WorkerProcesses {
  std::filesystem::path program;  ///< apvi
  int count = 1;                  ///< one for each device
  int threads = 1;                ///< of the CPU, of each
};
/// Starts processes that `work`, each with a GPU of its own if there are any, and waits for them. A
/// process that dies is started again, up to three times. Returns false when interrupted. Throws
/// RunError when the processes cannot finish the work.
bool work_in_processes(const std::filesystem::path& folder, const RefinePlan& plan,
                       const WorkerProcesses& processes, const Interrupted& interrupted);

}  // namespace apvi::runs
