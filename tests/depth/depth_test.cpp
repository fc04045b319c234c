// SPDX-License-Identifier: BSD-3-Clause
#include "depth/depth.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <limits>
#include <string>

#include "depth/depth_scene.hpp"

namespace apvi::depth {
namespace {

using test::block_errors;
using test::camera_at;
using test::depth_of;
using test::look;
using test::Plane;
using test::walk_along;
using torch::Tensor;

constexpr Plane kWall = {{0.0, 0.0, 1.0}, 2.0};
constexpr Plane kSlope = {{0.0, -0.5, 0.866}, 1.8};  // recedes downward

double share(const Tensor& mask) {
  return mask.to(torch::kFloat64).mean().item<double>();
}

void expect_right(const Plane& plane, const DepthRequest& request, const DepthOptions& options,
                  double max_error) {
  const DepthEstimate out = estimate_depth(request, options);
  ASSERT_EQ(out.status, DepthStatus::estimated);
  const Tensor truth = depth_of(plane, request.views.front().camera);
  const Tensor errors = block_errors(out, truth);
  EXPECT_LT(errors.median().item<double>(), max_error);
  EXPECT_GT(share(out.confident), 0.6);
  EXPECT_LT(share(errors.masked_select(out.confident) > 0.1), 0.01);
  EXPECT_LT(((out.dense - truth).abs() / truth).median().item<double>(), 2.0 * max_error);
}

TEST(EstimateDepth, RecoversWall) {
  expect_right(kWall, walk_along(kWall), {}, 0.003);
}

TEST(EstimateDepth, RecoversSlope) {
  expect_right(kSlope, walk_along(kSlope), {}, 0.005);
}

TEST(EstimateDepth, RecoversWallWithLinearDepthSpacing) {
  DepthOptions options;
  options.spacing = DepthSpacing::linear_depth;
  expect_right(kWall, walk_along(kWall), options, 0.003);
}

TEST(EstimateDepth, RecoversWallWithoutRangeAdaptation) {
  DepthOptions options;
  options.adapt_range = false;
  expect_right(kWall, walk_along(kWall), options, 0.01);
}

TEST(EstimateDepth, RecoversWallWithAbsoluteDifferences) {
  DepthOptions options;
  options.cost = PhotometricCost::absolute;
  const DepthRequest request = walk_along(kWall);
  const DepthEstimate out = estimate_depth(request, options);
  const Tensor errors = block_errors(out, depth_of(kWall, request.views.front().camera));
  EXPECT_LT(errors.median().item<double>(), 0.005);
  EXPECT_LT(share(errors.masked_select(out.confident) > 0.1), 0.01);
}

TEST(EstimateDepth, RecoversDepthOfTopLeftPixels) {
  DepthOptions options;
  options.quadtree.representative = BlockRepresentative::top_left;
  const DepthRequest request = walk_along(kSlope);
  const DepthEstimate out = estimate_depth(request, options);
  const Block& last = out.blocks.back();
  EXPECT_TRUE(torch::equal(out.points[-1], torch::tensor({static_cast<float>(last.x) + 0.5F,
                                                          static_cast<float>(last.y) + 0.5F})));
  const Tensor truth = depth_of(kSlope, request.views.front().camera);
  const Tensor pixels = out.points.to(torch::kInt64);
  const Tensor expected = truth.index({pixels.select(1, 1), pixels.select(1, 0)});
  EXPECT_LT(((out.depth - expected).abs() / expected).median().item<double>(), 0.01);
  EXPECT_LT(((out.dense - truth).abs() / truth).median().item<double>(), 0.01);
}

TEST(EstimateDepth, RecoversWallWithTheOptionsOfThePaper) {
  DepthOptions options;
  options.spacing = DepthSpacing::linear_depth;
  options.adapt_range = false;
  options.best_views_fraction = 1.0;
  options.cost = PhotometricCost::absolute;
  options.patch_intensity_sigma = 1e3;
  options.quadtree.min_block_px = 6;
  options.quadtree.representative = BlockRepresentative::top_left;
  options.belief_propagation.edge_sigma = 1e3;
  const DepthRequest request = walk_along(kWall);
  const DepthEstimate out = estimate_depth(request, options);
  const Tensor truth = depth_of(kWall, request.views.front().camera);
  EXPECT_LT(((out.dense - truth).abs() / truth).median().item<double>(), 0.05);
}

TEST(EstimateDepth, RecoversWallWhenImageSizeIsNoMultipleOfBlockSize) {
  DepthRequest request = walk_along(kWall);
  for (DepthView& view : request.views) {
    view.gray = view.gray.slice(0, 0, 117).slice(1, 0, 149).contiguous();
    view.camera.intrinsics.width = 149;
    view.camera.intrinsics.height = 117;
  }
  const DepthEstimate out = estimate_depth(request, {});
  EXPECT_EQ(out.dense.sizes(), request.views.front().gray.sizes());
  EXPECT_LT(
      block_errors(out, depth_of(kWall, request.views.front().camera)).median().item<double>(),
      0.005);
}

/// Bars of 7 cm, 9 cm apart, 1 m from the cameras, and a low-contrast wall one meter behind them,
/// seen from nine positions in a row.
constexpr Plane kBars = {{0.0, 0.0, 1.0}, 1.0};
Tensor is_bar(const gaussians::View& camera, double x) {
  const gaussians::Intrinsics& k = camera.intrinsics;
  const Tensor column = (torch::arange(k.width, torch::kFloat64) + 0.5 - k.cx) / k.fx + x;
  return (torch::remainder(column, 0.16) < 0.07).unsqueeze(0).expand({k.height, k.width});
}

DepthRequest before_bars() {
  DepthRequest request;
  for (const double x : {0.0, -0.04, 0.04, -0.08, 0.08, -0.12, 0.12, -0.16, 0.16}) {
    const gaussians::View camera = camera_at(x, 0.0, 0.0);
    DepthView view = look(kWall, camera, 0.5);
    view.gray = torch::where(is_bar(camera, x), look(kBars, camera).gray, view.gray);
    request.views.push_back(view);
  }
  return request;
}

/// Fraction of correct depths among the blocks on the wall that are more than half a patch from any
/// bar.
double right_behind_bars(const DepthOptions& options) {
  const DepthRequest request = before_bars();
  const DepthEstimate out = estimate_depth(request, options);
  const gaussians::View& camera = request.views.front().camera;
  const Tensor beside =
      torch::max_pool2d(is_bar(camera, 0.0).to(torch::kFloat32).unsqueeze(0), 7, 1, 3)[0] > 0.5;
  const Tensor at = out.points.to(torch::kInt64);
  const Tensor clear =
      ~beside.reshape({-1}).index_select(0, at.select(1, 1) * beside.size(1) + at.select(1, 0));
  EXPECT_GT(clear.sum().item<int>(), 100);
  const Tensor errors = block_errors(out, depth_of(kWall, camera));
  return share(errors.masked_select(clear) < 0.05);
}

TEST(EstimateDepth, RecoversWallBehindBars) {
  DepthOptions options;
  options.adapt_range = false;  // with range adaptation, averaging all views also succeeds
  const double found = right_behind_bars(options);
  EXPECT_GT(found, 0.75);
  options.best_views_fraction = 1.0;
  EXPECT_LT(right_behind_bars(options), found - 0.2);
}

TEST(EstimateDepth, AdaptedRangeIncludesBackgroundOfBars) {
  EXPECT_GT(right_behind_bars({}), 0.95);
}

TEST(EstimateDepth, IsRobustToGainOfOneView) {
  DepthRequest request = walk_along(kSlope);
  const DepthEstimate before = estimate_depth(request, {});
  request.views[2].gray = request.views[2].gray * 0.6;
  request.views[3].gray = (request.views[3].gray + 0.1).clamp(0.0, 1.0);
  const DepthEstimate after = estimate_depth(request, {});
  EXPECT_LT(((after.depth - before.depth).abs() / before.depth).median().item<double>(), 1e-3);
  EXPECT_NEAR(share(after.confident), share(before.confident), 0.05);
}

TEST(EstimateDepth, IsIndependentOfOrderOfOtherViews) {
  DepthRequest request = walk_along(kSlope);
  const DepthEstimate before = estimate_depth(request, {});
  std::swap(request.views[1], request.views[4]);
  const DepthEstimate after = estimate_depth(request, {});
  EXPECT_LT(((after.depth - before.depth).abs() / before.depth).median().item<double>(), 1e-5);
}

TEST(EstimateDepth, ScalesWithPoses) {
  DepthRequest request = walk_along(kSlope);
  const DepthEstimate before = estimate_depth(request, {});
  for (DepthView& view : request.views) {
    Tensor T = view.camera.T_camera_world.clone();
    T.slice(0, 0, 3).select(1, 3).mul_(1.5);
    view.camera.T_camera_world = T;
  }
  DepthOptions options;
  options.min_depth_m *= 1.5;
  options.max_depth_m *= 1.5;
  const DepthEstimate after = estimate_depth(request, options);
  EXPECT_LT(((after.depth / 1.5 - before.depth).abs() / before.depth).median().item<double>(),
            1e-3);
}

TEST(EstimateDepth, IsIndependentOfThreadCount) {
  const DepthRequest request = walk_along(kSlope);
  const int threads = torch::get_num_threads();
  torch::set_num_threads(1);
  const DepthEstimate one = estimate_depth(request, {});
  torch::set_num_threads(3);
  const DepthEstimate three = estimate_depth(request, {});
  torch::set_num_threads(threads);
  EXPECT_TRUE(torch::equal(one.depth, three.depth));
  EXPECT_TRUE(torch::equal(one.confidence, three.confidence));
  EXPECT_TRUE(torch::equal(one.dense, three.dense));
}

TEST(EstimateDepth, CompensatesKnownMedium) {
  // The far end of the slope is attenuated more from a distance, and backscatter is added.
  const medium::Medium medium = {.beta_d = torch::full({3}, 0.6),
                                 .beta_b = torch::full({3}, 0.5),
                                 .b_inf = torch::full({3}, 0.3)};
  DepthRequest request;
  for (const double z : {0.0, -0.15, 0.1, 0.2, -0.3, 0.3}) {
    DepthView view = look(kSlope, camera_at(0.5 * z, 0.1 * z, z));
    const gaussians::Intrinsics& k = view.camera.intrinsics;
    const Tensor x = (torch::arange(k.width) + 0.5 - k.cx) / k.fx;
    const Tensor y = (torch::arange(k.height) + 0.5 - k.cy) / k.fy;
    const Tensor range =
        depth_of(kSlope, view.camera) * (1.0 + x.square() + y.square().unsqueeze(1)).sqrt();
    view.gray = (view.gray * (-0.6 * range).exp() + 0.3 * (1.0 - (-0.5 * range).exp()))
                    .to(torch::kFloat32)
                    .contiguous();
    request.views.push_back(view);
  }
  DepthOptions options;
  options.cost = PhotometricCost::absolute;
  options.best_views_fraction = 1.0;  // includes views with a different path through the water
  const Tensor truth = depth_of(kSlope, request.views.front().camera);
  const Tensor without = block_errors(estimate_depth(request, options), truth);
  request.medium = medium;
  const Tensor with = block_errors(estimate_depth(request, options), truth);
  EXPECT_LT(with.mean().item<double>(), without.mean().item<double>());
  EXPECT_LT(with.median().item<double>(), 0.02);
  options.compensate_medium = false;
  EXPECT_TRUE(torch::equal(block_errors(estimate_depth(request, options), truth), without));
}

DepthStatus verdict_of(const DepthRequest& request) {
  const DepthEstimate out = estimate_depth(request, {});
  EXPECT_FALSE(out.confident.any().item<bool>());
  EXPECT_TRUE(torch::isfinite(out.dense).all().item<bool>());
  EXPECT_TRUE(torch::isfinite(out.depth).all().item<bool>());
  return out.status;
}

TEST(EstimateDepth, BlackImageHasNoConfidentDepth) {
  DepthRequest request = walk_along(kWall);
  request.views.front().gray.zero_();
  EXPECT_EQ(verdict_of(request), DepthStatus::no_contrast);
}

TEST(EstimateDepth, IgnoresBlackImageAmongOthers) {
  DepthRequest request = walk_along(kWall);
  request.views[2].gray.zero_();
  const DepthEstimate out = estimate_depth(request, {});
  EXPECT_LT(
      block_errors(out, depth_of(kWall, request.views.front().camera)).median().item<double>(),
      0.005);
}

TEST(EstimateDepth, SingleViewHasNoConfidentDepth) {
  DepthRequest request = walk_along(kWall);
  request.views.resize(1);
  EXPECT_EQ(verdict_of(request), DepthStatus::too_few_views);
}

TEST(EstimateDepth, ZeroBaselineHasNoConfidentDepth) {
  DepthRequest request;
  for (int i = 0; i < 5; ++i) request.views.push_back(look(kWall, camera_at(0.0, 0.0, 0.0)));
  EXPECT_EQ(verdict_of(request), DepthStatus::no_baseline);
}

TEST(EstimateDepth, PureRotationHasNoConfidentDepth) {
  DepthRequest request;
  for (const double yaw : {0.0, 0.05, -0.05, 0.1, -0.1}) {
    request.views.push_back(look(kWall, camera_at(0.0, 0.0, 0.0, yaw)));
  }
  EXPECT_EQ(verdict_of(request), DepthStatus::no_baseline);
}

TEST(EstimateDepth, MillimeterBaselineHasNoConfidentDepth) {
  DepthRequest request;
  for (const double x : {0.0, 0.0003, -0.0003, 0.0005, -0.0005}) {
    request.views.push_back(look(kWall, camera_at(x, 0.0, 0.0)));
  }
  EXPECT_EQ(verdict_of(request), DepthStatus::estimated);
}

TEST(EstimateDepth, NoiseHasFewConfidentDepths) {
  DepthRequest request = walk_along(kWall);
  torch::manual_seed(5);
  for (DepthView& view : request.views) view.gray = torch::rand_like(view.gray);
  EXPECT_LT(share(estimate_depth(request, {}).confident), 0.03);
}

std::string complaint(const DepthRequest& request) {
  try {
    estimate_depth(request, {});
  } catch (const c10::Error& error) {
    return error.what_without_backtrace();
  }
  return "";
}

TEST(EstimateDepth, ErrorNamesViewWithInvalidPose) {
  DepthRequest request = walk_along(kWall);
  request.views[3].camera.T_camera_world =
      request.views[3].camera.T_camera_world * std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(complaint(request), testing::HasSubstr("view 3: the pose is not finite"));
}

TEST(EstimateDepth, ErrorNamesViewWithInvalidImage) {
  DepthRequest request = walk_along(kWall);
  request.views[1].gray[5][5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(complaint(request), testing::HasSubstr("view 1: intensities"));
  request.views[1].gray = torch::zeros({10, 10});
  EXPECT_THAT(complaint(request), testing::HasSubstr("view 1: the image is [10, 10]"));
}

}  // namespace
}  // namespace apvi::depth
