// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/picture_alignment.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "apvi/mapping/view_corrections.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kFocal = 160.0;   // [px]
constexpr double kDistance = 3.0;  // of the wall [m]

splat::Intrinsics camera() {
  return {.fx = kFocal, .fy = kFocal, .cx = 96.0, .cy = 64.0, .width = 192, .height = 128};
}

Picture picture_from(const splat::Gaussians& world, const Tensor& T_camera_world) {
  return take_picture({.gaussians = world, .medium = std::nullopt},
                      {.intrinsics = camera(), .T_camera_world = T_camera_world, .pose_delta = {}});
}

/// A wall with texture and relief.
splat::Gaussians relief() {
  splat::Gaussians world = test::wall_of_gaussians(6000);
  world.log_scales = world.log_scales - 1.2;
  world.logit_opacities = world.logit_opacities + 2.0;
  world.means =
      world.means + torch::cat({torch::zeros({6000, 2}), 0.25 * torch::rand({6000, 1})}, 1);
  return world;
}

Tensor twist(double x, double y, double z, double a, double b, double c) {
  return torch::tensor({x, y, z, a, b, c}, torch::kFloat64);
}

Tensor moved(const Tensor& by) {
  return corrected_pose(torch::eye(4, torch::kFloat64), by);
}

/// How far two poses' pictures are apart, at the distance of the wall [px].
double pixels_apart(const Tensor& a, const Tensor& b) {
  const Tensor between = (a - b).slice(0, 0, 3);
  return kFocal * (between.slice(1, 0, 3).norm().item<double>() +
                   between.select(1, 3).norm().item<double>() / kDistance);
}

TEST(PictureAlignment, FindsThePlaceThatAPictureWasTakenFrom) {
  const splat::Gaussians world = relief();
  const Picture shown = picture_from(world, moved(twist(0, 0, 0, 0, 0, 0)));
  torch::manual_seed(5);
  for (const Tensor& true_twist :
       {twist(0.02, -0.01, 0.01, 0.002, -0.003, 0.004), twist(-0.10, 0.05, 0.04, 0.0, 0.01, -0.02),
        twist(0.0, 0.0, 0.08, 0.0, 0.0, 0.0)}) {
    const Tensor T = moved(true_twist);
    const Tensor seen = picture_from(world, T).as_seen;
    const Tensor noisy = seen + 0.01 * torch::randn_like(seen);
    const auto found = align_picture(shown, noisy, camera(), {0.1, 0.03});
    ASSERT_TRUE(found.has_value()) << true_twist;
    EXPECT_LT(pixels_apart(found->T_camera_believed, T), 0.3) << true_twist;
    EXPECT_LT(found->after, found->before);
    EXPECT_GT(found->share, 0.3);
  }
}

TEST(PictureAlignment, MindsNeitherExposureNorVeilNorWhatSwimsBefore) {
  const splat::Gaussians world = relief();
  const Picture shown = picture_from(world, moved(twist(0, 0, 0, 0, 0, 0)));
  const Tensor T = moved(twist(-0.04, 0.03, 0.02, 0.0, 0.004, -0.01));
  Tensor seen = 0.7 * picture_from(world, T).as_seen + 0.2;
  seen.slice(0, 40, 80).slice(1, 50, 100).fill_(1.0);  // a fish
  const auto found = align_picture(shown, seen, camera(), {0.1, 0.03});
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(pixels_apart(found->T_camera_believed, T), 0.3);
}

TEST(PictureAlignment, IsNoneOfAnotherPlaceOrThroughSilt) {
  torch::manual_seed(6);
  const splat::Gaussians world = relief();
  const Picture shown = picture_from(world, moved(twist(0, 0, 0, 0, 0, 0)));
  splat::Gaussians other = world;
  other.sh_dc = world.sh_dc.flip(0);
  const Tensor elsewhere = picture_from(other, moved(twist(0, 0, 0, 0, 0, 0))).as_seen;
  EXPECT_FALSE(align_picture(shown, elsewhere, camera(), {0.05, 0.02}).has_value());
  const Tensor seen = picture_from(world, moved(twist(0.03, 0.0, 0.0, 0.0, 0.0, 0.0))).as_seen;
  const Tensor silt = 0.4 + 0.05 * seen + 0.05 * torch::randn_like(seen);
  EXPECT_FALSE(align_picture(shown, silt, camera(), {0.05, 0.02}).has_value());
}

/// Waves of 50 px and of its own seed's fine grain, `shift` px aside.
Tensor like_from_afar(std::uint64_t seed, double shift) {
  torch::manual_seed(seed);
  const Tensor x = torch::arange(192, torch::kFloat32) - shift;
  const Tensor y = torch::arange(128, torch::kFloat32).unsqueeze(1);
  const Tensor waves = torch::sin(0.13 * x + 0.05 * y) + torch::sin(0.12 * y - 0.06 * x);
  const Tensor grain = torch::avg_pool2d(torch::randn({1, 1, 128, 192}), 3, 1, 1).view({128, 192});
  return (0.5 + 0.1 * waves + 0.1 * grain).unsqueeze(2).repeat({1, 1, 3});
}

TEST(PictureAlignment, IsNoneFarOffWhereHardlyMoreFitsThanBefore) {
  const Picture shown = {.as_seen = like_from_afar(1, 0.0),
                         .restored = {},
                         .depth = torch::full({128, 192}, kDistance),
                         .alpha = torch::ones({128, 192})};
  // What is alike from afar is 8 px aside; looked at closely it is another place.
  EXPECT_FALSE(align_picture(shown, like_from_afar(2, 8.0), camera(), {0.1, 0.03}).has_value());
  EXPECT_TRUE(align_picture(shown, like_from_afar(1, 0.0).roll(8, 1), camera(), {0.1, 0.03}));
}

TEST(PictureAlignment, IsNoneWhereTheMapIsNot) {
  const splat::Gaussians world = relief();
  Picture shown = picture_from(world, moved(twist(0, 0, 0, 0, 0, 0)));
  const Tensor seen = shown.as_seen.clone();
  shown.alpha.slice(1, 20).fill_(0.3);
  EXPECT_FALSE(align_picture(shown, seen, camera(), {0.1, 0.03}).has_value());
  shown.alpha.fill_(1.0);
  EXPECT_FALSE(align_picture(shown, seen, camera(), {0.1, 0.03}).has_value());  // stands right
}

}  // namespace
}  // namespace apvi::mapping
