// SPDX-License-Identifier: BSD-3-Clause
// When the mapper looks for depth, and how.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <optional>

#include "apvi/mapping/mapper.hpp"
#include "mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::wall_of_gaussians;
using torch::Tensor;

MapperOptions by_quadtree() {
  MapperOptions options = small_map_options();
  options.trainer.densify.kind = Densification::quadtree;
  options.online.depth_lag = 1;
  return options;
}

/// Thirty keyframes in such a hurry that none of them gets depth.
Mapper hurried(const splat::Gaussians& world, int final_iterations) {
  MapperOptions options = by_quadtree();
  options.trainer.final_iterations = final_iterations;
  Mapper mapper(options);
  for (int i = 0; i < 30; ++i) {
    MapperInput input;
    input.keyframe = test::photograph(world, test::camera_at(0.05 * i - 0.7, 0.0), i);
    input.points = points_of(world);
    input.hurry = true;
    mapper.add(input);
  }
  return mapper;
}

TEST(MapperDepth, IsNotLookedForInAHurryButInTheEnd) {
  Mapper mapper = hurried(wall_of_gaussians(), 200);
  EXPECT_EQ(mapper.times().of("depth"), 0.0);
  EXPECT_GT(mapper.waiting(), 0U);
  mapper.begin_final();
  EXPECT_EQ(mapper.waiting(), 0U);
  EXPECT_GT(mapper.times().of("depth"), 0.0);
}

// What is new takes steps to settle; a later refinement finds what still waits.
TEST(MapperDepth, AnEndWithoutRefinementLeavesTheMapAsItIs) {
  const test::TmpDir dir;
  const splat::Gaussians world = wall_of_gaussians();
  Mapper mapper = hurried(world, 0);
  const splat::Gaussians before = mapper.snapshot().gaussians;
  ASSERT_GT(before.size(), 0);
  mapper.begin_final();
  EXPECT_EQ(mapper.times().of("depth"), 0.0);
  EXPECT_TRUE(test::same(mapper.snapshot().gaussians, before));
  mapper.save(dir.path() / "checkpoint.pt");
  Mapper later = hurried(world, 200);
  later.resume(dir.path() / "checkpoint.pt");
  later.begin_final();
  EXPECT_GT(later.times().of("depth"), 0.0);
}

TEST(MapperDepth, ComesFromAllViewsByLamplightAndFromTheBestOfThemByDaylight) {
  const splat::Gaussians world = wall_of_gaussians();
  const auto means = [&world](double best_share, const std::optional<splat::Lamp>& lamp) {
    MapperOptions options = by_quadtree();
    options.trainer.lamp = lamp;
    options.depth.best_share = best_share;
    Mapper mapper(options);
    for (int i = 0; i < 12; ++i) {  // without a point: all there is comes from depth
      MapperInput input;
      input.keyframe = test::photograph(world, test::camera_at(0.1 * i - 0.6, 0.05 * (i % 3)), i);
      mapper.add(input);
    }
    EXPECT_GT(mapper.size(), 0);
    return mapper.snapshot().gaussians.means;
  };
  const splat::Lamp lamp{.position_m = {0.25, -0.15, 0.0}};
  EXPECT_TRUE(torch::equal(means(0.5, lamp), means(1.0, lamp)));
  const Tensor all = means(1.0, std::nullopt);
  const Tensor best = means(0.5, std::nullopt);
  EXPECT_FALSE(all.sizes() == best.sizes() && torch::equal(all, best));
}

}  // namespace
}  // namespace apvi::mapping
