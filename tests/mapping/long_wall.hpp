// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gaussians/model/rows.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"

/// A dive along a wall whose map is larger than the device.
namespace apvi::mapping {

inline constexpr double kLength_m = 48.0;
inline constexpr int kLimit = 1200;  // Gaussians on the device: about 20 m of the wall

/// A wall from x = 0 on, too long for the device.
inline gaussians::Gaussians long_wall() {
  gaussians::Gaussians wall = test::gaussian_wall(3000);
  wall.means.select(1, 0).add_(2.0).mul_(kLength_m / 4.0);
  wall.means.select(1, 1).mul_(0.6);
  wall.means.select(1, 2).fill_(3.0);
  return wall;
}

inline MapperOptions options_with(double stored_memory_mib) {
  MapperOptions options = small_map_options();
  options.trainer.densify.max_gaussians = kLimit;
  options.trainer.final_iterations = 400;
  options.trainer.learning_rates.sh_dc = 1e-2;
  options.online.stored_memory_mib = stored_memory_mib;
  return options;
}

/// Points that the camera can see only.
inline SparsePoints points_near(const gaussians::Gaussians& world, double x, std::int64_t number) {
  const torch::Tensor near =
      ((world.means.select(1, 0) - x).abs() < 1.5).nonzero().squeeze(1).slice(0, 0, 60);
  return points_of(gaussians::select(world, near), 10000 * number);
}

inline void visit(Mapper& mapper, const gaussians::Gaussians& world, double x, std::int64_t number,
                  int steps) {
  MapperInput input;
  const bool held_out = number % 8 == 3;
  input.keyframe = test::render_keyframe(world, test::camera_at(x, 0.0), number, held_out);
  if (!held_out) input.points = points_near(world, x, number);
  mapper.add(input);
  for (int k = 0; k < steps; ++k) mapper.step();
}

/// Along the wall, one keyframe per meter.
inline Mapper along_the_wall(const gaussians::Gaussians& world, const MapperOptions& options) {
  Mapper mapper(options);
  for (int number = 0; number < static_cast<int>(kLength_m); ++number) {
    visit(mapper, world, number, number, 4);
  }
  return mapper;
}

inline double psnr(const Mapper& mapper, std::size_t begin, std::size_t end) {
  std::vector<std::size_t> views;
  for (const std::size_t view : mapper.keyframes().held_out()) {
    if (view >= begin && view < end) views.push_back(view);
  }
  return *mean_psnr(mapper.snapshot(), mapper.keyframes(), views);
}

inline torch::Tensor own_means(const Mapper& mapper, std::int64_t keyframe) {
  const torch::Tensor own = (mapper.optimizer().anchors() == keyframe).nonzero().squeeze(1);
  return mapper.map().gaussians.means.index_select(0, own);
}

}  // namespace apvi::mapping
