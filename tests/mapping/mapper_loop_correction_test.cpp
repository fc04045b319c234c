// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using test::camera_at;
using torch::Tensor;

MapperInput input_of(const gaussians::Gaussians& world, double x, std::int64_t number,
                     bool held_out) {
  MapperInput input;
  input.keyframe = test::render_keyframe(world, camera_at(x, 0.0), number, held_out);
  if (held_out) return input;
  input.points = points_of(world, 1000 * number);
  return input;
}

/// Three keyframes, the second one followed by a held-out image.
Mapper three_keyframes(const gaussians::Gaussians& world) {
  MapperOptions options = small_map_options();
  options.trainer.densify.max_gaussians = 2000;
  Mapper mapper(options);
  mapper.add(input_of(world, -0.6, 0, false));
  mapper.add(input_of(world, 0.0, 1, false));
  MapperInput held_out = input_of(world, 0.1, 2, true);
  held_out.follows_ns = mapper.keyframes()[1].stamp_ns;
  mapper.add(held_out);
  mapper.add(input_of(world, 0.6, 3, false));
  return mapper;
}

Tensor shift_of(double x) {
  Tensor motion = torch::eye(4, torch::kFloat64);
  motion[0][3] = x;
  return motion;
}

Tensor own_means(const Mapper& mapper, std::int64_t keyframe) {
  const Tensor own = (mapper.optimizer().anchors() == keyframe).nonzero().squeeze(1);
  return mapper.snapshot().gaussians.means.index_select(0, own);
}

TEST(MapperLoopCorrection, MovesKeyframesGaussiansAndFollowers) {
  const gaussians::Gaussians world = test::gaussian_wall(300);
  Mapper mapper = three_keyframes(world);
  const KeyframeStore& keyframes = mapper.keyframes();
  std::vector<Tensor> centers;
  std::vector<Tensor> means;
  for (const std::int64_t i : {0, 1, 2, 3}) {
    centers.push_back(camera_center(mapper.pose(static_cast<std::size_t>(i))));
    means.push_back(own_means(mapper, i));
  }
  ASSERT_GT(means[0].size(0), 0);
  ASSERT_GT(means[1].size(0), 0);
  mapper.correct({{keyframes[1].stamp_ns, shift_of(0.2)},
                  {keyframes[1].stamp_ns + 1, shift_of(0.9)},  // not in the map
                  {keyframes[3].stamp_ns, shift_of(0.3)}});
  const std::vector<double> shifts = {0.0, 0.2, 0.2, 0.3};
  for (const std::size_t i : {0U, 1U, 2U, 3U}) {
    const Tensor moved = camera_center(mapper.pose(i)) - centers[i];
    EXPECT_NEAR(moved[0].item<double>(), shifts[i], 1e-9) << i;
    EXPECT_NEAR(moved.slice(0, 1).abs().max().item<double>(), 0.0, 1e-9) << i;
    const Tensor after = own_means(mapper, static_cast<std::int64_t>(i));
    if (after.size(0) == 0) continue;
    const Tensor by = (after - means[i]).select(1, 0);
    EXPECT_TRUE(torch::allclose(by, torch::full_like(by, shifts[i]), 0.0, 1e-5)) << i;
  }
}

TEST(MapperLoopCorrection, AppliesTheLastCorrectionToLaterKeyframes) {
  const gaussians::Gaussians world = test::gaussian_wall(300);
  Mapper mapper = three_keyframes(world);
  mapper.correct({{mapper.keyframes()[3].stamp_ns, shift_of(0.3)}});
  mapper.add(input_of(world, 0.8, 4, false));
  EXPECT_NEAR(camera_center(mapper.pose(4))[0].item<double>(), 1.1, 1e-9);
  // An unchanged odometry pose does not move the keyframe.
  MapperInput news;
  news.moved = {{mapper.keyframes()[4].stamp_ns, camera_at(0.8, 0.0)}};
  mapper.add(news);
  EXPECT_NEAR(camera_center(mapper.pose(4))[0].item<double>(), 1.1, 1e-9);
}

TEST(MapperLoopCorrection, KeepsCorrectedHeldOutImagesInTheWindow) {
  const gaussians::Gaussians world = test::gaussian_wall(300);
  Mapper mapper = three_keyframes(world);
  // The held-out image is in the odometry window too, and the next one follows it.
  MapperInput next = input_of(world, 0.7, 4, true);
  next.follows_ns = mapper.keyframes()[2].stamp_ns;
  mapper.add(next);
  mapper.correct({{mapper.keyframes()[1].stamp_ns, shift_of(0.2)},
                  {mapper.keyframes()[3].stamp_ns, shift_of(0.3)}});
  MapperInput news;
  news.moved = {{mapper.keyframes()[2].stamp_ns, camera_at(0.1, 0.0)}};  // its odometry pose
  mapper.add(news);
  EXPECT_NEAR(camera_center(mapper.pose(2))[0].item<double>(), 0.3, 1e-9);
  EXPECT_NEAR(camera_center(mapper.pose(4))[0].item<double>(), 1.0, 1e-9);
}

TEST(MapperLoopCorrection, IgnoresInvalidMotions) {
  const gaussians::Gaussians world = test::gaussian_wall(300);
  Mapper mapper = three_keyframes(world);
  const Tensor before = mapper.pose(3).clone();
  mapper.correct({{mapper.keyframes()[3].stamp_ns, 2.0 * shift_of(0.3)}});
  EXPECT_TRUE(torch::equal(mapper.pose(3), before));
}

}  // namespace
}  // namespace apvi::mapping
