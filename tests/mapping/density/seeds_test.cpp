// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/seeds.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "map_io/ply.hpp"
#include "medium/medium.hpp"
#include "support/posed_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

medium::Medium some_water() {
  return {.beta_d = torch::tensor({0.3, 0.1, 0.15}, torch::kFloat64),
          .beta_b = torch::tensor({0.25, 0.1, 0.1}, torch::kFloat64),
          .b_inf = torch::tensor({0.05, 0.2, 0.3}, torch::kFloat64)};
}

TEST(RemoveMedium, InvertsTheMediumModel) {
  torch::manual_seed(4);
  const Tensor colors = torch::rand({50, 3}, torch::kFloat64);
  const Tensor ranges = torch::rand({50}, torch::kFloat64) * 3.0 + 0.2;
  const Tensor seen = medium::apply_medium(colors.unsqueeze(1), ranges.unsqueeze(1),
                                           torch::ones({50, 1}, torch::kFloat64), some_water())
                          .squeeze(1);
  Tensor points = torch::randn({50, 3}, torch::kFloat64);
  points = points * (ranges / points.norm(2, 1)).unsqueeze(1);
  EXPECT_TRUE(test::tensors_near(remove_medium(seen, points, some_water()), colors, 1e-9));
}

TEST(GaussiansFromSeeds, ProjectToTheirPixels) {
  const gaussians::Gaussians world = test::gaussian_wall();
  KeyframeStore keyframes;
  keyframes.add(test::render_keyframe(world, test::camera_at(0.2, -0.1), 0));
  const Seeds seeds = {.pixels = torch::tensor({{10.5, 20.5}, {40.25, 3.0}}, torch::kFloat64),
                       .depths = torch::tensor({2.0, 3.5}, torch::kFloat64),
                       .radii_px = torch::tensor({1.0, 4.0}, torch::kFloat64),
                       .opacities = torch::tensor({0.2, 0.1}, torch::kFloat64)};
  const gaussians::Gaussians made = gaussians_from_seeds(seeds, keyframes, 0, 1, std::nullopt);
  const ProjectedPoints seen =
      project(keyframes.view(0, 1), made.means.to(torch::kCPU, torch::kFloat64));
  EXPECT_TRUE(test::tensors_near(seen.pixels, seeds.pixels, 1e-4));
  EXPECT_TRUE(test::tensors_near(seen.depths, seeds.depths, 1e-5));
  EXPECT_NEAR(made.log_scales.exp()[1][0].item<float>(), 4.0 * 3.5 / 40.0, 1e-5);
  EXPECT_NEAR(made.logit_opacities.sigmoid()[0].item<float>(), 0.2, 1e-6);
  const Tensor color = keyframes[0].image[20][10].to(torch::kFloat32) / 255.0;
  EXPECT_TRUE(test::tensors_near(gaussians::sh_dc_to_color(made.sh_dc)[0], color, 1e-5));
  EXPECT_EQ(made.sh_degree(), 1);
}

TEST(GaussiansFromSeeds, AreNotMadeOfWhatTheMaskHides) {
  KeyframeStore keyframes;
  const Tensor scene = torch::ones({32, 48}, torch::kBool);
  scene.slice(0, 0, 10).fill_(false);
  keyframes.set_mask(scene);
  keyframes.add(test::render_keyframe(test::gaussian_wall(), test::camera_at(0.0, 0.0), 0));
  const Seeds seeds = {
      .pixels = torch::tensor({{5.5, 9.5}, {5.5, 10.5}, {40.5, 30.5}}, torch::kFloat64),
      .depths = torch::full({3}, 2.0, torch::kFloat64),
      .radii_px = torch::ones({3}, torch::kFloat64),
      .opacities = torch::full({3}, 0.1, torch::kFloat64)};
  EXPECT_EQ(gaussians_from_seeds(seeds, keyframes, 0, 0, std::nullopt).size(), 2);
}

}  // namespace
}  // namespace apvi::mapping
