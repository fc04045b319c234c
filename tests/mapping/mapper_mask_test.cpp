// SPDX-License-Identifier: BSD-3-Clause
// Pixels that a mask hides have no part in a map.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "mapping/evaluation.hpp"
#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using test::camera_at;
using test::gaussian_wall;
using torch::Tensor;

MapperOptions quick_options() {
  MapperOptions options = small_map_options();
  options.trainer.learning_rates.means = 1e-3;
  options.trainer.learning_rates.sh_dc = 1e-2;
  return options;
}

MapperInput input_of(const gaussians::Gaussians& world, double x, double y, std::int64_t number) {
  MapperInput input;
  input.keyframe = test::render_keyframe(world, camera_at(x, y), number);
  input.points = points_of(world);
  return input;
}

/// Paints what is not the scene.
MapperInput with_gripper(MapperInput input, const Tensor& scene) {
  input.keyframe.image = torch::where(scene.unsqueeze(2), input.keyframe.image,
                                      torch::tensor({255, 0, 255}, torch::kUInt8));
  return input;
}

TEST(MapperMask, WhatTheMaskHidesIsNotInTheMap) {
  const gaussians::Gaussians world = gaussian_wall();
  const Tensor scene = torch::ones({32, 48}, torch::kBool);
  scene.slice(0, 22).slice(1, 10, 38).fill_(false);
  const auto psnr_of = [&](bool masked) {
    Mapper mapper(quick_options());
    if (masked) mapper.set_mask(scene);
    for (int i = 0; i < 9; ++i) {
      MapperInput input = input_of(world, 0.1 * i - 0.4, 0.25 * (i % 3 - 1), i);
      mapper.add(with_gripper(std::move(input), scene));
      for (int k = 0; k < 40 && mapper.ready(); ++k) mapper.step();
    }
    KeyframeStore clean;  // what a camera without a gripper sees
    clean.add(test::render_keyframe(world, camera_at(0.05, 0.1), 99, /*held_out=*/true));
    return *mean_psnr(mapper.snapshot(), clean, {0});
  };
  const double masked = psnr_of(true);
  EXPECT_GT(masked, 18.0);
  EXPECT_GT(masked, psnr_of(false) + 3.0);
}

TEST(MapperMask, TheMaskIsInTheCheckpoint) {
  const test::TmpDir dir;
  const gaussians::Gaussians world = gaussian_wall();
  const Tensor scene = torch::ones({32, 48}, torch::kBool);
  scene.slice(0, 22).fill_(false);
  Mapper mapper(quick_options());
  mapper.set_mask(scene);
  for (int i = 0; i < 3; ++i) mapper.add(input_of(world, 0.1 * i, 0.0, i));
  MapperInput diver = input_of(world, 0.2, 0.0, 10);
  diver.keyframe.scene = torch::ones({32, 48}, torch::kBool);
  diver.keyframe.scene.slice(1, 0, 5).fill_(false);
  mapper.add(diver);
  mapper.save(dir.path() / "map.pt");
  Mapper resumed(quick_options());
  resumed.resume(dir.path() / "map.pt");
  ASSERT_TRUE(resumed.keyframes().scene(0, 1, torch::kCPU).defined());
  EXPECT_TRUE(torch::equal(resumed.keyframes().scene(0, 1, torch::kCPU), scene));
  EXPECT_EQ(resumed.keyframes().scene(3, 1, torch::kCPU).sum().item<int>(), 22 * 43);
}

}  // namespace
}  // namespace apvi::mapping
