// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/map_snapshot.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "apvi/core/error.hpp"
#include "slam/map_access.hpp"

namespace apvi::slam {
namespace {

torch::Tensor ramp(std::vector<std::int64_t> shape) {
  std::int64_t count = 1;
  for (const std::int64_t n : shape) count *= n;
  return (0.1F * torch::arange(1, count + 1, torch::kFloat32)).reshape(shape);
}

mapping::Map lit_map() {
  mapping::Map map;
  map.gaussians = {.means = ramp({5, 3}),
                   .log_scales = -ramp({5, 3}),
                   .quaternions = ramp({5, 4}),
                   .logit_opacities = ramp({5}),
                   .sh_dc = ramp({5, 3}),
                   .sh_rest = ramp({5, 8, 3})};
  map.medium = medium::Medium{.beta_d = ramp({3}), .beta_b = 2.0F * ramp({3}), .b_inf = ramp({3})};
  map.medium->lamp = medium::LampLight{
      .lamps = {{.position_m = {0.1, 0.2, 0.3}, .axis = {0.0, 0.6, 0.8}, .half_beam_rad = 0.7}},
      .unit_range_m = 1.5,
      .daylight = ramp({3}),
      .backscatter = 3.0F * ramp({3})};
  map.antialiased = true;
  map.tone_curve = gaussians::kSrgb;
  map.vignetting = {.square = 0.25, .fourth = 0.125};
  return map;
}

RenderView view() {
  CameraModel::Parameters camera{.fx = 30.0, .fy = 30.0, .cx = 15.5, .cy = 11.5};
  camera.width = 32;
  camera.height = 24;
  return {camera, SE3{Eigen::Quaterniond::Identity(), {0.5, 0.5, -1.0}}};
}

TEST(MapSnapshot, KeepsEveryNumberOfTheMap) {
  const mapping::Map map = lit_map();
  const mapping::Map back = to_map(to_snapshot({.map = map, .keyframes = {}}));
  for (std::size_t i = 0; i < map.gaussians.tensors().size(); ++i) {
    EXPECT_TRUE(torch::equal(*map.gaussians.tensors()[i], *back.gaussians.tensors()[i])) << i;
  }
  EXPECT_TRUE(torch::equal(map.medium->beta_b, back.medium->beta_b));
  EXPECT_TRUE(torch::equal(medium::lamp_to_tensor(*map.medium->lamp),
                           medium::lamp_to_tensor(*back.medium->lamp)));
  EXPECT_TRUE(back.antialiased);
  EXPECT_EQ(back.tone_curve, map.tone_curve);
  EXPECT_EQ(back.vignetting.square, map.vignetting.square);
  EXPECT_EQ(back.vignetting.fourth, map.vignetting.fourth);
}

TEST(MapSnapshot, RendersAsTheMapDoes) {
  const mapping::Map map = lit_map();
  const RenderedImages images = render(to_snapshot({.map = map, .keyframes = {}}), view());
  const auto expected =
      render_image(map, {.intrinsics = to_intrinsics(view().camera),
                         .T_camera_world = to_tensor(view().T_world_camera.inverse()),
                         .pose_delta = {}});
  const torch::Tensor color = torch::tensor(images.color).reshape({24, 32, 3});
  EXPECT_TRUE(torch::equal(color, expected.color.to(torch::kCPU)));
  EXPECT_GT(expected.alpha.max().item<float>(), 0.5F);
}

TEST(MapSnapshot, OriginMovesTheMap) {
  MapSnapshot snapshot = to_snapshot({.map = lit_map(), .keyframes = {}});
  const RenderedImages before = render(snapshot, view());
  snapshot.origin = {1000.0, 2000.0, -3000.0};
  RenderView moved = view();
  moved.T_world_camera.translation += Eigen::Vector3d(1000.0, 2000.0, -3000.0);
  EXPECT_EQ(render(snapshot, moved).depth, before.depth);
}

TEST(MapSnapshot, ArraysOfContradictorySizesAreAnError) {
  MapSnapshot snapshot = to_snapshot({.map = lit_map(), .keyframes = {}});
  snapshot.log_scales.pop_back();
  EXPECT_THROW(render(snapshot, view()), InputError);
  snapshot.log_scales.push_back(0.0F);
  snapshot.sh_coefficients = 7;
  EXPECT_THROW(render(snapshot, view()), InputError);
}

}  // namespace
}  // namespace apvi::slam
