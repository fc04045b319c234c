// SPDX-License-Identifier: BSD-3-Clause
// Compares depth on a GPU with depth on the CPU, which is tested against references.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <vector>

#include "depth/depth.hpp"
#include "depth/depth_backend.hpp"
#include "depth/depth_geometry.hpp"
#include "depth/depth_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::depth {
namespace {

using apvi::test::tensors_near;
using test::Plane;
using torch::Tensor;

constexpr Plane kSlope = {{0.2, -0.3, 1.0}, 2.0};
constexpr int kBlockSide = 8;

class CudaDepth : public testing::Test {
 protected:
  void SetUp() override {
    if (!torch::cuda::is_available()) GTEST_SKIP() << "no GPU usable by LibTorch";
  }
};

std::vector<Tensor> grays_of(const DepthRequest& request, const torch::Device& device) {
  std::vector<Tensor> grays;
  for (const DepthView& view : request.views) grays.push_back(view.gray.to(device));
  return grays;
}

DepthRequest on_gpu(DepthRequest request) {
  for (DepthView& view : request.views) view.gray = view.gray.to(torch::kCUDA);
  return request;
}

/// Sweeps a grid of points over the images of `request` on `device`.
SweepInput sweep_input(const DepthRequest& request, const torch::Device& device) {
  const SweepGeometry geometry = on_device(sweep_geometry(request.views), device);
  const gaussians::Intrinsics& k = request.views.front().camera.intrinsics;
  std::vector<float> points;
  for (int y = 0; y < k.height; y += kBlockSide) {
    for (int x = 0; x < k.width; x += kBlockSide) {
      points.push_back(static_cast<float>(x) + 4.0F);
      points.push_back(static_cast<float>(y) + 4.0F);
    }
  }
  const Tensor places = torch::tensor(points).reshape({-1, 2}).to(device);
  const std::int64_t n = places.size(0);
  return {.projections = geometry.projections,
          .points = places,
          .levels = (torch::arange(n, torch::kInt32) % 3).to(device, torch::kInt32),
          .inverse_depths = torch::linspace(2.0, 0.1, 100).unsqueeze(0).to(device),
          .slopes = 0.002 * torch::ones({n, 2}).to(device),
          .rays = geometry.rays,
          .centers = geometry.centers,
          .cost = PhotometricCost::zncc,
          .noise = 1.0 / 255.0,
          .medium = {}};
}

SweepOutput swept(const DepthBackend& backend, const DepthRequest& request,
                  const torch::Device& device, const SweepInput& input) {
  const SweepOutput out = backend.sweep(backend.prepare(grays_of(request, device)), input);
  return {.cost = out.cost.to(torch::kCPU), .views = out.views.to(torch::kCPU)};
}

/// Fraction of the elements that differ by more than `tolerance`.
double share_off(const Tensor& a, const Tensor& b, double tolerance) {
  return ((a - b).abs() > tolerance).to(torch::kFloat32).mean().item<double>();
}

void expect_similar(const DepthRequest& request, const SweepInput& on_cpu,
                    const SweepInput& gpu_input) {
  const SweepOutput a = swept(cpu_depth_backend(), request, torch::kCPU, on_cpu);
  const SweepOutput b = swept(depth_backend(torch::kCUDA), request, torch::kCUDA, gpu_input);
  // Rounding decides where a patch touches the border or a step is at the limit of a pyramid level.
  EXPECT_LT(share_off(a.views.to(torch::kFloat32), b.views.to(torch::kFloat32), 0.5), 1e-3);
  EXPECT_LT(share_off(a.cost, b.cost, 1e-3), 2e-3);
  EXPECT_GT(a.cost.std().item<double>(), 0.05);
}

TEST_F(CudaDepth, SweepMatchesCpu) {
  const DepthRequest request = test::walk_along(kSlope);
  expect_similar(request, sweep_input(request, torch::kCPU), sweep_input(request, torch::kCUDA));
}

TEST_F(CudaDepth, SweepOfFewHypothesesPerPointMatchesCpu) {
  const DepthRequest request = test::walk_along(kSlope);
  SweepInput a = sweep_input(request, torch::kCPU);
  SweepInput b = sweep_input(request, torch::kCUDA);
  const Tensor own = (0.5 + 0.001 * torch::arange(a.points.size(0)).unsqueeze(1)) *
                     torch::linspace(1.1, 0.9, 9).unsqueeze(0);
  a.inverse_depths = own.to(torch::kFloat32).contiguous();
  b.inverse_depths = a.inverse_depths.to(torch::kCUDA);
  expect_similar(request, a, b);
}

TEST_F(CudaDepth, SweepWithBestViewsMatchesCpu) {
  const DepthRequest request = test::walk_along(kSlope);
  for (const double share : {0.1, 0.5, 0.8}) {
    SweepInput a = sweep_input(request, torch::kCPU);
    SweepInput b = sweep_input(request, torch::kCUDA);
    a.best_share = b.best_share = share;
    expect_similar(request, a, b);
  }
}

TEST_F(CudaDepth, SweepWithMaxViewsMatchesCpu) {
  DepthRequest request = test::walk_along(kSlope);
  while (request.views.size() < 32)
    request.views.push_back(request.views[request.views.size() - 5]);
  for (const double share : {0.5, 1.0}) {
    SweepInput a = sweep_input(request, torch::kCPU);
    SweepInput b = sweep_input(request, torch::kCUDA);
    a.best_share = b.best_share = share;
    expect_similar(request, a, b);
  }
}

TEST_F(CudaDepth, SweepWithMediumMatchesCpu) {
  const DepthRequest request = test::walk_along(kSlope);
  SweepInput a = sweep_input(request, torch::kCPU);
  SweepInput b = sweep_input(request, torch::kCUDA);
  for (SweepInput* input : {&a, &b}) {
    input->cost = PhotometricCost::absolute;
    input->medium = {.beta_d = 0.3, .beta_b = 0.25, .b_inf = 0.4};
  }
  expect_similar(request, a, b);
}

/// Graph of a grid of blocks with random costs.
BeliefPropagationInput belief_input(std::int64_t labels) {
  torch::manual_seed(4);
  const Tensor gray = torch::rand({96, 128});
  const std::vector<Block> blocks = build_quadtree(gray, {.split_threshold = 0.45});
  const BlockGraph graph = neighbor_graph(blocks, 128, 96);
  const auto edges = static_cast<std::int64_t>(graph.neighbors.size());
  Tensor weights = torch::empty({edges});
  for (std::int64_t e = 0; e < edges; ++e) {  // symmetric
    const auto back = graph.reverse[static_cast<std::size_t>(e)];
    weights[e] = 0.2 + 0.1 * static_cast<double>(std::min<std::int64_t>(e, back) % 7);
  }
  return {.cost = torch::rand({static_cast<std::int64_t>(blocks.size()), labels}),
          .offsets = torch::tensor(graph.offsets, torch::kInt32),
          .neighbors = torch::tensor(graph.neighbors, torch::kInt32),
          .reverse = torch::tensor(graph.reverse, torch::kInt32),
          .weights = weights,
          .step = 0.02,
          .limit = 0.3,
          .iterations = 7};
}

TEST_F(CudaDepth, BeliefPropagationMatchesCpuForAnyHypothesisCount) {
  for (const std::int64_t labels : {9, 32, 61, 128, 130, 256, 700}) {
    BeliefPropagationInput input = belief_input(labels);
    const Tensor expected = cpu_depth_backend().propagate(input);
    for (Tensor* t :
         {&input.cost, &input.offsets, &input.neighbors, &input.reverse, &input.weights}) {
      *t = t->to(torch::kCUDA);
    }
    const Tensor got = depth_backend(torch::kCUDA).propagate(input).to(torch::kCPU);
    EXPECT_TRUE(tensors_near(got, expected, 2e-4)) << labels << " hypotheses";
  }
}

TEST_F(CudaDepth, PlaneFitMatchesCpu) {
  const BeliefPropagationInput graph = belief_input(8);
  const std::int64_t blocks = graph.cost.size(0);
  PlaneFitInput input = {.inverse_depths = 0.5 + 0.1 * torch::rand({blocks}),
                         .points = 100.0 * torch::rand({blocks, 2}),
                         .offsets = graph.offsets,
                         .neighbors = graph.neighbors,
                         .max_relative_difference = 0.1,
                         .max_slope = 0.002};
  const FittedPlanes expected = cpu_depth_backend().fit_planes(input);
  for (Tensor* t : {&input.inverse_depths, &input.points, &input.offsets, &input.neighbors}) {
    *t = t->to(torch::kCUDA);
  }
  const FittedPlanes got = depth_backend(torch::kCUDA).fit_planes(input);
  EXPECT_TRUE(torch::equal(got.agreement.cpu(), expected.agreement));
  EXPECT_TRUE(tensors_near(got.slope.cpu(), expected.slope, 1e-7));
  EXPECT_LT(expected.agreement.min().item<float>(), 0.9F);
}

TEST_F(CudaDepth, SmoothingMatchesCpu) {
  torch::manual_seed(8);
  for (const auto& [height, width] :
       {std::pair{48, 64}, {1, 70}, {33, 1}, {120, 161}, {2, 3000}, {1025, 3}}) {
    SmoothInput input = {.guide = torch::rand({height, width}),
                         .values = torch::rand({height, width}),
                         .weights = (torch::rand({height, width}) < 0.3).to(torch::kFloat32),
                         .options = {}};
    const Tensor expected = cpu_depth_backend().smooth(input);
    for (Tensor* t : {&input.guide, &input.values, &input.weights}) *t = t->to(torch::kCUDA);
    const Tensor got = depth_backend(torch::kCUDA).smooth(input).to(torch::kCPU);
    EXPECT_LT((got[1] - expected[1]).abs().max().item<double>(), 2e-4);
    const Tensor known = expected[1] > 1e-3;
    EXPECT_LT((got[0] - expected[0]).abs().masked_select(known).max().item<double>(), 2e-3);
  }
}

TEST_F(CudaDepth, EstimateMatchesCpu) {
  const DepthRequest request = test::walk_along(kSlope);
  const DepthEstimate a = estimate_depth(request, {});
  const DepthEstimate b = estimate_depth(on_gpu(request), {});
  ASSERT_EQ(b.status, DepthStatus::estimated);
  ASSERT_EQ(a.blocks.size(), b.blocks.size());
  EXPECT_TRUE(b.depth.device().is_cpu() && b.dense.device().is_cpu());
  EXPECT_NEAR(a.near_m, b.near_m, 0.02 * a.near_m);
  EXPECT_LT(share_off(a.depth.log(), b.depth.log(), 0.01), 0.03);
  EXPECT_LT(share_off(a.confident.to(torch::kFloat32), b.confident.to(torch::kFloat32), 0.5), 0.03);
  EXPECT_LT(share_off(a.dense.log(), b.dense.log(), 0.01), 0.03);
  const Tensor truth = test::depth_of(kSlope, request.views.front().camera);
  EXPECT_LT(test::block_errors(b, truth).median().item<float>(), 0.01F);
}

TEST_F(CudaDepth, IsDeterministic) {
  const DepthRequest request = on_gpu(test::walk_along(kSlope));
  const DepthEstimate a = estimate_depth(request, {});
  const DepthEstimate b = estimate_depth(request, {});
  EXPECT_TRUE(torch::equal(a.depth, b.depth));
  EXPECT_TRUE(torch::equal(a.dense, b.dense));
}

}  // namespace
}  // namespace apvi::depth
