// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "gaussians/model/gaussians.hpp"
#include "mapping/training/map_optimizer.hpp"
#include "medium/medium.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/refine/refine_plan.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// What a task of a refinement starts from.
struct RefineInput {
  RunConfig config;                ///< of the run
  PosedImages images;              ///< of the block, with their poses so far
  gaussians::Gaussians gaussians;  ///< of the block and around it; on the device that renders
  std::optional<medium::Medium> medium;
  mapping::CameraResponse response;  ///< of the images
  std::int64_t steps = 0;            ///< in earlier rounds
  double seconds = 0.0;              ///< of these
};

/// Reads the images and the results of the previous round. Throws InputError.
RefineInput load_refine_input(const std::filesystem::path& folder, const RefinePlan& plan,
                              const RefineTask& task, ImageCache& images);

}  // namespace apvi::runs
