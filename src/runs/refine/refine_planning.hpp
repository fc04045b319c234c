// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "runs/refine/refine_plan.hpp"

namespace apvi::runs {

struct RefinePlanOptions {
  int blocks = 0;  ///< 0: so many that a block has few enough images; at least `min_blocks`
  int min_blocks = 1;
  int rounds = 4;
  int steps_per_image = 30;
  int max_gaussians = 0;  ///< of a block and what surrounds it; 0: as the run was configured
};

/// Splits the map of a run into blocks and assigns its training images to them by what they show,
/// and writes the plan and the map of the first round into the run folder `folder`. Throws
/// InputError when the run has no map, or none that its images show.
RefinePlan make_plan(const std::filesystem::path& run, const std::filesystem::path& folder,
                     const RefinePlanOptions& options);

}  // namespace apvi::runs
