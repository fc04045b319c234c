// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/detail/detail_levels.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <limits>

#include "gaussians/render/render.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using apvi::test::tensors_near;
using torch::Tensor;

constexpr double kFocal_px = 120.0;

/// A camera above (0, 0) that looks down the z axis, at a height over the plane z = 0.
View view_from(double height_m, int factor = 1) {
  View view;
  view.intrinsics = {.fx = kFocal_px * factor,
                     .fy = kFocal_px * factor,
                     .cx = 64.0 * factor,
                     .cy = 48.0 * factor,
                     .width = 128 * factor,
                     .height = 96 * factor};
  view.T_camera_world = torch::eye(4, torch::kFloat64);
  view.T_camera_world[2][3] = height_m;
  return view;
}

/// A floor of 6 x 6 m of flat Gaussians, 2.5 cm apart, whose colors change over decimeters.
Gaussians make_floor() {
  torch::manual_seed(4);
  const Tensor line = torch::arange(-3.0, 3.0, 0.025, torch::kFloat32);
  const auto grid = torch::meshgrid({line, line}, "ij");
  const Tensor x = grid[0].flatten();
  const Tensor y = grid[1].flatten();
  const std::int64_t n = x.size(0);
  Gaussians g = Gaussians::empty(1, torch::dtype(torch::kFloat32));
  g.means = torch::stack({x, y, 0.1 * torch::sin(2.0 * x)}, 1) + 0.004 * torch::randn({n, 3});
  g.log_scales = torch::tensor({0.016F, 0.016F, 0.002F}).log().repeat({n, 1});
  g.quaternions = torch::tensor({1.0F, 0.0F, 0.0F, 0.0F}).repeat({n, 1});
  g.logit_opacities = torch::full({n}, 2.0);
  g.sh_dc = torch::stack({torch::sin(9.0 * x), torch::sin(7.0 * y), torch::sin(8.0 * (x + y))}, 1) +
            0.3 * torch::randn({n, 3});
  g.sh_rest = 0.05 * torch::randn({n, 3, 3});
  return g;
}

Tensor image_of(const Gaussians& g, const View& view) {
  return render(g, view, {}).color;
}

/// The mean over pixels four times as fine.
Tensor reference_image(const Gaussians& g, double height_m) {
  const Tensor fine = image_of(g, view_from(height_m, 4)).permute({2, 0, 1}).unsqueeze(0);
  return torch::avg_pool2d(fine, 4).squeeze(0).permute({1, 2, 0});
}

double rms(const Tensor& a, const Tensor& b) {
  return std::sqrt((a - b).square().mean().item<double>());
}

TEST(DetailLevels, OfTheFinestDetailDrawTheMapItself) {
  const Gaussians g = make_floor();
  const View view = view_from(2.0);
  const Gaussians drawn = DetailLevels(g).select(view, 0.0);
  EXPECT_LT(drawn.size(), g.size());  // the rest is outside of the image
  EXPECT_TRUE(tensors_near(image_of(drawn, view), image_of(g, view), 1e-5));
}

TEST(DetailLevels, HaveFewerGaussiansFromLevelToLevel) {
  const Gaussians g = make_floor();
  const std::vector<std::int64_t> sizes = DetailLevels(g).sizes();
  ASSERT_EQ(sizes.size(), 7U);
  EXPECT_EQ(sizes.front(), g.size());
  for (std::size_t k = 2; k < sizes.size(); ++k) EXPECT_LT(2 * sizes[k], sizes[k - 1]);
}

// All Gaussians together are too wide there: each is at least about a pixel.
TEST(DetailLevels, DrawDistantSurfacesBetterThanAllGaussians) {
  const Gaussians g = make_floor();
  const DetailLevels levels(g);
  for (const double height_m : {12.0, 25.0, 50.0}) {
    const View view = view_from(height_m);
    const Gaussians drawn = levels.select(view, 1.0);
    const Tensor reference = reference_image(g, height_m);
    EXPECT_LT(5 * drawn.size(), g.size()) << height_m;
    EXPECT_LT(rms(image_of(drawn, view), reference), 0.75 * rms(image_of(g, view), reference))
        << height_m;
  }
}

TEST(DetailLevels, AreTheMapItselfNearby) {
  const Gaussians g = make_floor();
  const View view = view_from(2.0);
  EXPECT_LT(rms(image_of(DetailLevels(g).select(view, 1.0), view), image_of(g, view)), 1e-3);
}

TEST(DetailLevels, GiveTheFinestLevelOfAtMostSoManyGaussians) {
  const Gaussians g = make_floor();
  const DetailLevels levels(g);
  const std::vector<std::int64_t> sizes = levels.sizes();
  EXPECT_EQ(levels.at_most(g.size()).size(), g.size());
  EXPECT_EQ(levels.at_most(sizes[2]).size(), sizes[2]);
  EXPECT_EQ(levels.at_most(sizes[2] - 1).size(), sizes[3]);
  EXPECT_EQ(levels.at_most(0).size(), sizes.back());
}

TEST(DetailLevels, DrawNothingOutsideOfTheView) {
  const DetailLevels levels(make_floor());
  View view = view_from(2.0);
  view.T_camera_world[0][3] = 50.0;  // the floor is to the right of the camera
  EXPECT_EQ(levels.select(view, 1.0).size(), 0);
}

TEST(DetailLevels, KeepLargeGaussiansAmongSmallOnes) {
  Gaussians g = make_floor();
  g.log_scales[17] = std::log(5.0);
  const Gaussians coarse = DetailLevels(g).select(view_from(100.0), 1.0);
  EXPECT_NEAR(coarse.log_scales.max().item<double>(), std::log(5.0), 1e-6);
}

TEST(DetailLevels, LeaveOutWhatIsNotFinite) {
  Gaussians g = make_floor();
  g.means[5][0] = std::numeric_limits<float>::quiet_NaN();
  g.log_scales[6][1] = std::numeric_limits<float>::infinity();
  const DetailLevels levels(g);
  EXPECT_EQ(levels.sizes().front(), g.size() - 2);
  const Gaussians drawn = levels.select(view_from(30.0), 2.0);
  for (const Tensor* tensor : drawn.tensors()) {
    EXPECT_TRUE(torch::isfinite(*tensor).all().item<bool>());
  }
}

TEST(DetailLevels, OfAnEmptyMapDrawNothing) {
  const DetailLevels levels(Gaussians::empty(3, torch::dtype(torch::kFloat32)));
  EXPECT_EQ(levels.select(view_from(2.0), 1.0).size(), 0);
}

}  // namespace
}  // namespace apvi::gaussians
