// SPDX-License-Identifier: BSD-3-Clause
// Depth estimation in the mapper.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <optional>

#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::gaussian_wall;
using torch::Tensor;

MapperOptions by_quadtree() {
  MapperOptions options = small_map_options();
  options.trainer.densify.kind = Densification::quadtree;
  options.online.depth_lag_keyframes = 1;
  return options;
}

/// Thirty keyframes, all with depth estimation deferred.
Mapper mapper_with_deferred_depth(const gaussians::Gaussians& world, int final_iterations) {
  MapperOptions options = by_quadtree();
  options.trainer.final_iterations = final_iterations;
  Mapper mapper(options);
  for (int i = 0; i < 30; ++i) {
    MapperInput input;
    input.keyframe = test::render_keyframe(world, test::camera_at(0.05 * i - 0.7, 0.0), i);
    input.points = points_of(world);
    input.skip_depth = true;
    mapper.add(input);
  }
  return mapper;
}

TEST(MapperDepth, IsDeferredUntilTheFinalRefinement) {
  Mapper mapper = mapper_with_deferred_depth(gaussian_wall(), 200);
  EXPECT_EQ(mapper.depth_s(), 0.0);
  EXPECT_GT(mapper.waiting(), 0U);
  mapper.begin_final();
  EXPECT_EQ(mapper.waiting(), 0U);
  EXPECT_GT(mapper.depth_s(), 0.0);
}

// Inserted Gaussians need steps to converge; a later refinement processes the queue.
TEST(MapperDepth, IsSkippedAtTheEndWithoutRefinement) {
  const test::TmpDir dir;
  const gaussians::Gaussians world = gaussian_wall();
  Mapper mapper = mapper_with_deferred_depth(world, 0);
  const gaussians::Gaussians before = mapper.snapshot().gaussians;
  ASSERT_GT(before.size(), 0);
  mapper.begin_final();
  EXPECT_EQ(mapper.times().seconds("depth"), 0.0);
  EXPECT_TRUE(test::bitwise_equal(mapper.snapshot().gaussians, before));
  mapper.save(dir.path() / "checkpoint.pt");
  Mapper later = mapper_with_deferred_depth(world, 200);
  later.resume(dir.path() / "checkpoint.pt");
  later.begin_final();
  EXPECT_GT(later.times().seconds("depth"), 0.0);
}

TEST(MapperDepth, UsesAllViewsWithLampAndTheBestViewsInDaylight) {
  const gaussians::Gaussians world = gaussian_wall();
  const auto means = [&world](double best_share, const std::vector<medium::Lamp>& lamps) {
    MapperOptions options = by_quadtree();
    options.trainer.lamps = lamps;
    options.depth.best_views_fraction = best_share;
    Mapper mapper(options);
    for (int i = 0; i < 12; ++i) {  // without points: all Gaussians come from depth
      MapperInput input;
      input.keyframe =
          test::render_keyframe(world, test::camera_at(0.1 * i - 0.6, 0.05 * (i % 3)), i);
      mapper.add(input);
    }
    EXPECT_GT(mapper.size(), 0);
    return mapper.snapshot().gaussians.means;
  };
  const medium::Lamp lamp{.position_m = {0.25, -0.15, 0.0}};
  EXPECT_TRUE(torch::equal(means(0.5, {lamp}), means(1.0, {lamp})));
  const Tensor all = means(1.0, {});
  const Tensor best = means(0.5, {});
  EXPECT_FALSE(all.sizes() == best.sizes() && torch::equal(all, best));
}

}  // namespace
}  // namespace apvi::mapping
