// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>

#include "runs/maps/posed_images.hpp"
#include "runs/refine/refine_plan.hpp"

namespace apvi::runs {

struct RefineTaskHooks {
  std::function<bool()> interrupted = [] { return false; };  ///< polled after every step
  std::function<void(double)> progress = [](double) {};      ///< 0 to 1
};

/// Optimizes one block of a refinement in one round, with everything else that its images show, and
/// writes its result. The result depends on the plan and the results of the previous round only.
///
/// Blocks are the overlapping domains of a restricted additive Schwarz method (Cai and Sarkis, SIAM
/// J. Sci. Comput. 21 (2), 1999): each is optimized together with its surroundings as they were
/// after the previous round, and of the result only the block itself is kept, so that overlaps need
/// no averaging. `images` keeps what this process has decoded, for its next tasks.
///
/// Saves a checkpoint every minute and when interrupted, from which it continues. Returns false
/// when interrupted. Throws InputError when files of the previous round cannot be read, RunError
/// when something cannot be written, c10::Error when the device is out of memory.
bool run_task(const std::filesystem::path& folder, const RefinePlan& plan, const RefineTask& task,
              ImageCache& images, const RefineTaskHooks& hooks);

}  // namespace apvi::runs
