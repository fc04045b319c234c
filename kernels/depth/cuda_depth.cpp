// SPDX-License-Identifier: BSD-3-Clause
// Passes tensor memory to the kernel launchers of depth estimation.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include <algorithm>
#include <utility>

#include "depth/depth_backend.hpp"
#include "kernels/depth/depth.hpp"

namespace apvi::depth {
namespace {

using torch::Tensor;

static_assert(cuda::kDepthLevels == kSweepLevels);

constexpr std::int64_t kMinSide = 8;  // [px] minimum image size of a patch
constexpr double kIntensityScale = 255.0 * 256.0;

int as_int(std::int64_t value) {
  return static_cast<int>(value);
}

void check_count(std::size_t images) {
  TORCH_CHECK(images <= cuda::kMaxViews + 1, "depth: ", images, " images; ", cuda::kMaxViews + 1,
              " is the maximum on a GPU");
}

/// Builds the pyramids of all images at once, as separate kernel launches would take longer than
/// the kernels.
class Pyramids {
 public:
  explicit Pyramids(const std::vector<Tensor>& grays) {
    check_count(grays.size());
    for (const Tensor& gray : grays) pixels_.push_back(gray.contiguous());
    levels_.resize(grays.size() * kSweepLevels);
  }

  std::vector<Tensor> reduced() && {
    for (int level = 0; level < kSweepLevels; ++level) reduce(level);
    return std::move(levels_);
  }

 private:
  void reduce(int level) {
    cuda::ReductionJobs in = {.jobs = {},
                              .count = as_int(static_cast<std::int64_t>(pixels_.size())),
                              .halve = level > 0,
                              .unit = static_cast<float>(kIntensityScale)};
    const std::int64_t part = in.halve ? 2 : 1;
    std::vector<Tensor> smaller;  // keeps the inputs allocated until the launch
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      const Tensor& from = pixels_[i];
      const std::int64_t height = from.size(0) / part;
      const std::int64_t width = from.size(1) / part;
      const bool fits = std::min(height, width) >= kMinSide;
      Tensor& level_pixels = levels_[i * kSweepLevels + static_cast<std::size_t>(level)];
      level_pixels =
          torch::empty({fits ? height : 0, fits ? width : 0}, from.options().dtype(torch::kInt32));
      smaller.push_back(torch::empty(level_pixels.sizes(), from.options()));
      in.jobs[i] = {
          .from = from.data_ptr<float>(),
          .from_width = as_int(from.size(1)),
          .to = smaller.back().data_ptr<float>(),
          .pairs = reinterpret_cast<std::uint32_t*>(level_pixels.data_ptr<std::int32_t>()),
          .width = as_int(level_pixels.size(1)),
          .height = as_int(level_pixels.size(0))};
    }
    C10_CUDA_CHECK(cuda::launch_reduction(in, at::cuda::getCurrentCUDAStream()));
    pixels_ = std::move(smaller);
  }

  std::vector<Tensor> pixels_;  ///< of the last level
  std::vector<Tensor> levels_;
};

cuda::ImagePyramid to_pyramid(const Tensor* levels) {
  cuda::ImagePyramid pyramid = {};
  for (; pyramid.count < kSweepLevels && levels[pyramid.count].numel() > 0; ++pyramid.count) {
    const Tensor& level = levels[pyramid.count];
    pyramid.levels[pyramid.count] = {
        .pairs = reinterpret_cast<const std::uint32_t*>(level.data_ptr<std::int32_t>()),
        .width = as_int(level.size(1)),
        .height = as_int(level.size(0))};
  }
  return pyramid;
}

cuda::SweepPointers to_pointers(const SweepImages& images, const SweepInput& in) {
  const std::size_t count = images.pyramids.size() / kSweepLevels;
  check_count(count);
  cuda::SweepPointers out = {.pyramids = {},
                             .views = as_int(static_cast<std::int64_t>(count)) - 1,
                             .points = as_int(in.points.size(0)),
                             .labels = as_int(in.inverse_depths.size(1)),
                             .projections = in.projections.data_ptr<float>(),
                             .places = in.points.data_ptr<float>(),
                             .levels = in.levels.data_ptr<std::int32_t>(),
                             .inverse_depths = in.inverse_depths.data_ptr<float>(),
                             .shared_depths = in.inverse_depths.size(0) == 1,
                             .slopes = in.slopes.data_ptr<float>(),
                             .rays = in.rays.data_ptr<float>(),
                             .centers = in.centers.data_ptr<float>(),
                             .absolute = in.cost == PhotometricCost::absolute,
                             .counted = {},
                             .noise = static_cast<float>(in.noise * kIntensityScale),
                             .patch_sigma = static_cast<float>(in.patch_sigma * kIntensityScale),
                             .beta_d = in.medium.beta_d,
                             .beta_b = in.medium.beta_b,
                             .b_inf = in.medium.b_inf};
  for (std::size_t i = 0; i < count; ++i) {
    out.pyramids[i] = to_pyramid(&images.pyramids[i * kSweepLevels]);
  }
  for (int seen = 0; seen <= out.views; ++seen) {
    out.counted[seen] = best_view_count(seen, in.best_share);
  }
  return out;
}

cuda::GraphPointers to_pointers(const BeliefPropagationInput& in) {
  TORCH_CHECK(in.cost.size(1) <= cuda::kMaxLabels, "depth: ", in.cost.size(1), " hypotheses; ",
              cuda::kMaxLabels, " is the maximum on a GPU");
  return {.nodes = as_int(in.cost.size(0)),
          .labels = as_int(in.cost.size(1)),
          .cost = in.cost.data_ptr<float>(),
          .offsets = in.offsets.data_ptr<std::int32_t>(),
          .neighbors = in.neighbors.data_ptr<std::int32_t>(),
          .reverse = in.reverse.data_ptr<std::int32_t>(),
          .weights = in.weights.data_ptr<float>(),
          .step = static_cast<float>(in.step),
          .limit = static_cast<float>(in.limit)};
}

class CudaDepthBackend final : public DepthBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  SweepImages prepare(const std::vector<Tensor>& grays) const override {
    if (grays.empty()) return {};
    const c10::cuda::CUDAGuard guard(grays.front().device());
    return {.pyramids = Pyramids(grays).reduced()};
  }

  SweepOutput sweep(const SweepImages& images, const SweepInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.points.device());
    const auto options = input.points.options();
    const std::vector<std::int64_t> shape = {input.points.size(0), input.inverse_depths.size(1)};
    SweepOutput out = {.cost = torch::empty(shape, options),
                       .views = torch::empty(shape, options.dtype(torch::kUInt8))};
    C10_CUDA_CHECK(cuda::launch_sweep(to_pointers(images, input), out.cost.data_ptr<float>(),
                                      out.views.data_ptr<std::uint8_t>(),
                                      at::cuda::getCurrentCUDAStream()));
    return out;
  }

  Tensor propagate(const BeliefPropagationInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.cost.device());
    const cuda::GraphPointers graph = to_pointers(input);
    const auto stream = at::cuda::getCurrentCUDAStream();
    Tensor now = torch::zeros({input.neighbors.size(0), input.cost.size(1)}, input.cost.options());
    Tensor next = torch::zeros_like(now);
    for (int i = 0; i < input.iterations; ++i) {
      C10_CUDA_CHECK(
          cuda::launch_messages(graph, now.data_ptr<float>(), next.data_ptr<float>(), stream));
      std::swap(now, next);
    }
    Tensor belief = torch::empty_like(input.cost);
    C10_CUDA_CHECK(cuda::launch_beliefs(graph, now.data_ptr<float>(), next.data_ptr<float>(),
                                        belief.data_ptr<float>(), stream));
    return belief;
  }

  FittedPlanes fit_planes(const PlaneFitInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.points.device());
    FittedPlanes out = {.agreement = torch::empty_like(input.inverse_depths),
                        .slope = torch::empty_like(input.points)};
    C10_CUDA_CHECK(cuda::launch_plane_fit({.nodes = as_int(input.inverse_depths.size(0)),
                                           .inverse_depths = input.inverse_depths.data_ptr<float>(),
                                           .places = input.points.data_ptr<float>(),
                                           .offsets = input.offsets.data_ptr<std::int32_t>(),
                                           .neighbors = input.neighbors.data_ptr<std::int32_t>(),
                                           .max_relative_difference = input.max_relative_difference,
                                           .max_slope = input.max_slope,
                                           .agreement = out.agreement.data_ptr<float>(),
                                           .slope = out.slope.data_ptr<float>()},
                                          at::cuda::getCurrentCUDAStream()));
    return out;
  }

  Tensor smooth(const SmoothInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.guide.device());
    const int height = as_int(input.guide.size(0));
    const int width = as_int(input.guide.size(1));
    TORCH_CHECK(std::max(height, width) <= cuda::kMaxLineLength, "depth: an image of ", width,
                " x ", height, "; at most ", cuda::kMaxLineLength,
                " px per side are supported on a GPU");
    Tensor out = torch::stack({input.values * input.weights, input.weights});
    for (int round = 1; round <= input.options.iterations; ++round) {
      for (const bool rows : {true, false}) {
        C10_CUDA_CHECK(
            cuda::launch_smooth_lines(input.guide.data_ptr<float>(), height, width, rows,
                                      input.lambda(round), static_cast<float>(input.options.sigma),
                                      out.data_ptr<float>(), at::cuda::getCurrentCUDAStream()));
      }
    }
    out[0].div_(out[1].clamp_min(1e-20));
    return out;
  }
};

}  // namespace

const DepthBackend& cuda_depth_backend() {
  static const CudaDepthBackend backend;
  return backend;
}

}  // namespace apvi::depth
