// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cstdint>

#include "apvi/mapping/mapper.hpp"
#include "apvi/splat/gaussians.hpp"

/// What tests of the mapper give it of `wall_of_gaussians`.
namespace apvi::mapping {

/// A map that learns whole pictures, colours without direction, and does not grow by itself.
inline MapperOptions small_map_options() {
  MapperOptions options;
  options.trainer.sh_degree = 0;
  options.trainer.coarsest = 1;
  options.trainer.densify.kind = Densification::none;
  options.trainer.densify.max_gaussians = 900;
  options.online.keyframe_share = 1.0;
  return options;
}

/// The middles of the world's Gaussians, as a front end would have triangulated them.
inline SparsePoints points_of(const splat::Gaussians& world, std::int64_t first_id = 0) {
  return {.ids = torch::arange(first_id, first_id + world.size(), torch::kInt64),
          .positions = world.means.to(torch::kFloat64),
          .sigmas = torch::full({world.size()}, 0.01, torch::kFloat64)};
}

}  // namespace apvi::mapping
