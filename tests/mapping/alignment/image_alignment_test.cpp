// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/image_alignment.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "mapping/appearance/view_corrections.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kFocal = 160.0;   // [px]
constexpr double kDistance = 3.0;  // to the wall [m]

gaussians::Intrinsics camera() {
  return {.fx = kFocal, .fy = kFocal, .cx = 96.0, .cy = 64.0, .width = 192, .height = 128};
}

MapRendering image_from(const gaussians::Gaussians& world, const Tensor& T_camera_world) {
  return render_map({.gaussians = world, .medium = std::nullopt},
                    {.intrinsics = camera(), .T_camera_world = T_camera_world, .pose_delta = {}});
}

/// A wall with texture and relief.
gaussians::Gaussians relief() {
  gaussians::Gaussians world = test::gaussian_wall(6000);
  world.log_scales = world.log_scales - 1.2;
  world.logit_opacities = world.logit_opacities + 2.0;
  world.means =
      world.means + torch::cat({torch::zeros({6000, 2}), 0.25 * torch::rand({6000, 1})}, 1);
  return world;
}

Tensor twist(double x, double y, double z, double a, double b, double c) {
  return torch::tensor({x, y, z, a, b, c}, torch::kFloat64);
}

Tensor pose_of(const Tensor& by) {
  return corrected_pose(torch::eye(4, torch::kFloat64), by);
}

/// Displacement between the images of two poses at the distance of the wall [px].
double pixels_apart(const Tensor& a, const Tensor& b) {
  const Tensor between = (a - b).slice(0, 0, 3);
  return kFocal * (between.slice(1, 0, 3).norm().item<double>() +
                   between.select(1, 3).norm().item<double>() / kDistance);
}

TEST(ImageAlignment, EstimatesTheCameraPose) {
  const gaussians::Gaussians world = relief();
  const MapRendering rendering = image_from(world, pose_of(twist(0, 0, 0, 0, 0, 0)));
  torch::manual_seed(5);
  for (const Tensor& true_twist :
       {twist(0.02, -0.01, 0.01, 0.002, -0.003, 0.004), twist(-0.10, 0.05, 0.04, 0.0, 0.01, -0.02),
        twist(0.0, 0.0, 0.08, 0.0, 0.0, 0.0)}) {
    const Tensor T = pose_of(true_twist);
    const Tensor image = image_from(world, T).color;
    const Tensor noisy = image + 0.01 * torch::randn_like(image);
    const auto alignment = align_image(rendering, noisy, camera(), {0.1, 0.03});
    ASSERT_TRUE(alignment.has_value()) << true_twist;
    EXPECT_LT(pixels_apart(alignment->T_camera_prior, T), 0.3) << true_twist;
    EXPECT_LT(alignment->residual_after, alignment->residual_before);
    EXPECT_GT(alignment->overlap, 0.3);
  }
}

TEST(ImageAlignment, IsRobustToExposureVeilingLightAndOcclusion) {
  const gaussians::Gaussians world = relief();
  const MapRendering rendering = image_from(world, pose_of(twist(0, 0, 0, 0, 0, 0)));
  const Tensor T = pose_of(twist(-0.04, 0.03, 0.02, 0.0, 0.004, -0.01));
  Tensor image = 0.7 * image_from(world, T).color + 0.2;
  image.slice(0, 40, 80).slice(1, 50, 100).fill_(1.0);  // a fish
  const auto alignment = align_image(rendering, image, camera(), {0.1, 0.03});
  ASSERT_TRUE(alignment.has_value());
  EXPECT_LT(pixels_apart(alignment->T_camera_prior, T), 0.3);
}

TEST(ImageAlignment, RejectsOtherPlacesAndSilt) {
  torch::manual_seed(6);
  const gaussians::Gaussians world = relief();
  const MapRendering rendering = image_from(world, pose_of(twist(0, 0, 0, 0, 0, 0)));
  gaussians::Gaussians other = world;
  other.sh_dc = world.sh_dc.flip(0);
  const Tensor elsewhere = image_from(other, pose_of(twist(0, 0, 0, 0, 0, 0))).color;
  EXPECT_FALSE(align_image(rendering, elsewhere, camera(), {0.05, 0.02}).has_value());
  const Tensor image = image_from(world, pose_of(twist(0.03, 0.0, 0.0, 0.0, 0.0, 0.0))).color;
  const Tensor silt = 0.4 + 0.05 * image + 0.05 * torch::randn_like(image);
  EXPECT_FALSE(align_image(rendering, silt, camera(), {0.05, 0.02}).has_value());
}

/// Waves of 50 px shifted by `shift` px, with fine texture that depends on the seed.
Tensor waves_with_texture(std::uint64_t seed, double shift) {
  torch::manual_seed(seed);
  const Tensor x = torch::arange(192, torch::kFloat32) - shift;
  const Tensor y = torch::arange(128, torch::kFloat32).unsqueeze(1);
  const Tensor waves = torch::sin(0.13 * x + 0.05 * y) + torch::sin(0.12 * y - 0.06 * x);
  const Tensor grain = torch::avg_pool2d(torch::randn({1, 1, 128, 192}), 3, 1, 1).view({128, 192});
  return (0.5 + 0.1 * waves + 0.1 * grain).unsqueeze(2).repeat({1, 1, 3});
}

TEST(ImageAlignment, RejectsLargeShiftsWithLittleImprovement) {
  const MapRendering rendering = {.color = waves_with_texture(1, 0.0),
                                  .restored = {},
                                  .depth = torch::full({128, 192}, kDistance),
                                  .alpha = torch::ones({128, 192})};
  // The coarse structure matches at 8 px, the fine texture does not match at all.
  EXPECT_FALSE(
      align_image(rendering, waves_with_texture(2, 8.0), camera(), {0.1, 0.03}).has_value());
  EXPECT_TRUE(align_image(rendering, waves_with_texture(1, 0.0).roll(8, 1), camera(), {0.1, 0.03}));
}

TEST(ImageAlignment, ReturnsNothingWithoutOverlapOrImprovement) {
  const gaussians::Gaussians world = relief();
  MapRendering rendering = image_from(world, pose_of(twist(0, 0, 0, 0, 0, 0)));
  const Tensor image = rendering.color.clone();
  rendering.alpha.slice(1, 20).fill_(0.3);
  EXPECT_FALSE(align_image(rendering, image, camera(), {0.1, 0.03}).has_value());
  rendering.alpha.fill_(1.0);
  EXPECT_FALSE(align_image(rendering, image, camera(), {0.1, 0.03})
                   .has_value());  // the prior pose is correct already
}

}  // namespace
}  // namespace apvi::mapping
