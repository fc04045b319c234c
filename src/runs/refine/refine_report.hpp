// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>

#include "runs/refine/refine_plan.hpp"

namespace apvi::runs {

/// Figures of a refined map.
struct RefineFigures {
  std::int64_t gaussians = 0;
  std::int64_t steps = 0;
  double psnr_db = 0.0;         ///< of held-out images; NaN when there are none
  double psnr_before_db = 0.0;  ///< of the run's own map; NaN when unknown
};

/// Puts the blocks of a finished refinement together and writes the files of a run with a map:
/// map.ply, keyframes.tum, resolved.yaml, rendered held-out images and metrics.json with the
/// section `refine`. Trajectories and places are those of the refined run. `wall_s`: of the
/// refinement.
RefineFigures write_refined_run(const std::filesystem::path& folder, const RefinePlan& plan,
                                double wall_s);

}  // namespace apvi::runs
