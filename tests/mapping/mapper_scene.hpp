// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cstdint>

#include "gaussians/model/gaussians.hpp"
#include "mapping/mapper.hpp"

/// Mapper input for tests, from `gaussian_wall`.
namespace apvi::mapping {

/// Options for full-resolution images, SH degree 0 and no densification.
inline MapperOptions small_map_options() {
  MapperOptions options;
  options.trainer.sh_degree = 0;
  options.trainer.initial_downscale = 1;
  options.trainer.densify.kind = Densification::none;
  options.trainer.densify.max_gaussians = 900;
  options.online.keyframe_budget_fraction = 1.0;
  return options;
}

/// The world's Gaussian means as triangulated sparse points.
inline SparsePoints points_of(const gaussians::Gaussians& world, std::int64_t first_id = 0) {
  return {.ids = torch::arange(first_id, first_id + world.size(), torch::kInt64),
          .positions = world.means.to(torch::kFloat64),
          .sigmas = torch::full({world.size()}, 0.01, torch::kFloat64)};
}

}  // namespace apvi::mapping
