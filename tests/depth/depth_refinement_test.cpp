// SPDX-License-Identifier: BSD-3-Clause
#include "depth/depth_refinement.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "depth/depth_scene.hpp"

namespace apvi::depth {
namespace {

using torch::Tensor;

const test::Plane kSlanted{.n = {0.25, -0.1, 0.96}, .offset = 2.0};

/// Images of a plane, and its depth in the first one, at half of their resolution.
struct Scene {
  RefinementRequest request;
  Tensor truth;

  explicit Scene(double strength = 1.0) {
    request.views = test::walk_along(kSlanted, strength).views;
    gaussians::View coarse = request.views.front().camera;
    coarse.intrinsics = coarse.intrinsics.scaled(80, 60);
    truth = test::depth_of(kSlanted, coarse);
    request.depth = truth.clone();
  }
  /// Relative errors of the refined depth where the images are confident.
  Tensor errors(const RefinedDepth& refined) const {
    return (request.depth * refined.ratio / truth - 1.0).index({refined.confidence > 0.02}).abs();
  }
};

TEST(RefineDepth, DepthThatIsFourPercentOffReturnsToTheSurface) {
  Scene scene;
  for (const double factor : {0.96, 1.0, 1.04}) {
    scene.request.depth = scene.truth * factor;
    const RefinedDepth refined = refine_depth(scene.request, {});
    const Tensor errors = scene.errors(refined);
    EXPECT_GT(errors.numel(), scene.truth.numel() * 9 / 10) << factor;
    EXPECT_LT(errors.median().item<double>(), 0.006) << factor;
    EXPECT_LT(torch::quantile(errors, 0.95).item<double>(), 0.025) << factor;
  }
}

TEST(RefineDepth, AnErrorOfAPartOfTheImageIsCorrectedThere) {
  Scene scene;
  scene.request.depth.slice(1, 0, 40) *= 1.03;
  const RefinedDepth refined = refine_depth(scene.request, {});
  EXPECT_NEAR(refined.ratio.slice(1, 4, 36).median().item<double>(), 1.0 / 1.03, 0.004);
  EXPECT_NEAR(refined.ratio.slice(1, 44, 76).median().item<double>(), 1.0, 0.004);
}

TEST(RefineDepth, NoiseOfTheGivenDepthDoesNotReturn) {
  Scene scene;
  torch::manual_seed(3);
  const Tensor noise = torch::avg_pool2d(torch::randn({1, 1, 62, 82}), 3, 1);
  scene.request.depth = scene.truth * (1.0 + 0.03 * (noise / noise.std()).squeeze(0).squeeze(0));
  const double given = (scene.request.depth / scene.truth - 1.0).abs().median().item<double>();
  const Tensor errors = scene.errors(refine_depth(scene.request, {}));
  EXPECT_GT(errors.numel(), scene.truth.numel() * 9 / 10);
  EXPECT_LT(errors.median().item<double>(), 0.4 * given);
}

TEST(RefineDepth, UniformImagesConfirmNothing) {
  const Scene scene(0.0);
  const RefinedDepth refined = refine_depth(scene.request, {});
  EXPECT_LT(refined.confidence.max().item<double>(), 0.02);
}

TEST(RefineDepth, ASurfaceBeyondTheSearchIsNotConfirmed) {
  Scene scene;
  scene.request.depth = scene.truth * 4.0;
  const RefinedDepth refined = refine_depth(scene.request, {});
  EXPECT_LT((refined.confidence > 0.02).to(torch::kFloat32).mean().item<double>(), 0.1);
}

TEST(RefineDepth, UnknownPixelsAndSingleImagesConfirmNothing) {
  Scene scene;
  scene.request.depth.slice(0, 0, 20) = 0.0;
  const RefinedDepth refined = refine_depth(scene.request, {});
  EXPECT_EQ(refined.confidence.slice(0, 0, 20).max().item<double>(), 0.0);
  EXPECT_EQ((refined.ratio.slice(0, 0, 20) - 1.0).abs().max().item<double>(), 0.0);
  scene.request.views.resize(1);
  EXPECT_EQ(refine_depth(scene.request, {}).confidence.max().item<double>(), 0.0);
  scene.request.depth.zero_();
  EXPECT_EQ(refine_depth(scene.request, {}).confidence.max().item<double>(), 0.0);
}

TEST(RefineDepth, DepthOfAnotherTypeIsRefused) {
  Scene scene;
  scene.request.depth = scene.truth.to(torch::kFloat64);
  EXPECT_THROW(refine_depth(scene.request, {}), c10::Error);
}

}  // namespace
}  // namespace apvi::depth
