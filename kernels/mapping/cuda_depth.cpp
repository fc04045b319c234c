// SPDX-License-Identifier: BSD-3-Clause
// Depth estimation's file that sees LibTorch and CUDA: it hands the memory of tensors to the
// launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include <algorithm>
#include <utility>

#include "apvi/mapping/depth_backend.hpp"
#include "depth.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

static_assert(cuda::kDepthLevels == kSweepLevels);

constexpr std::int64_t kLeastSide = 8;  // [px] of a picture that a patch fits into
constexpr double kUnits = 255.0 * 256.0;

int as_int(std::int64_t value) {
  return static_cast<int>(value);
}

void check_count(std::size_t pictures) {
  TORCH_CHECK(pictures <= cuda::kMostViews + 1, "depth: ", pictures, " pictures; ",
              cuda::kMostViews + 1, " can be compared on a GPU");
}

/// Pictures on their way through their reductions, all of them at once: launching one kernel for
/// each takes longer than what they do.
class Pyramids {
 public:
  explicit Pyramids(const std::vector<Tensor>& greys) {
    check_count(greys.size());
    for (const Tensor& grey : greys) pixels_.push_back(grey.contiguous());
    kept_.resize(greys.size() * kSweepLevels);
  }

  std::vector<Tensor> reduced() && {
    for (int level = 0; level < kSweepLevels; ++level) reduce(level);
    return std::move(kept_);
  }

 private:
  void reduce(int level) {
    cuda::ReductionJobs in = {.jobs = {},
                              .count = as_int(static_cast<std::int64_t>(pixels_.size())),
                              .halve = level > 0,
                              .unit = static_cast<float>(kUnits)};
    const std::int64_t part = in.halve ? 2 : 1;
    std::vector<Tensor> smaller;  // what they are made of must not be freed before the launch
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      const Tensor& from = pixels_[i];
      const std::int64_t height = from.size(0) / part;
      const std::int64_t width = from.size(1) / part;
      const bool fits = std::min(height, width) >= kLeastSide;
      Tensor& kept = kept_[i * kSweepLevels + static_cast<std::size_t>(level)];
      kept =
          torch::empty({fits ? height : 0, fits ? width : 0}, from.options().dtype(torch::kInt32));
      smaller.push_back(torch::empty(kept.sizes(), from.options()));
      in.jobs[i] = {.from = from.data_ptr<float>(),
                    .from_width = as_int(from.size(1)),
                    .to = smaller.back().data_ptr<float>(),
                    .pairs = reinterpret_cast<std::uint32_t*>(kept.data_ptr<std::int32_t>()),
                    .width = as_int(kept.size(1)),
                    .height = as_int(kept.size(0))};
    }
    C10_CUDA_CHECK(cuda::launch_reduction(in, at::cuda::getCurrentCUDAStream()));
    pixels_ = std::move(smaller);
  }

  std::vector<Tensor> pixels_;  ///< of the last reduction
  std::vector<Tensor> kept_;
};

cuda::PicturePyramid to_pyramid(const Tensor* kept) {
  cuda::PicturePyramid pyramid = {};
  for (; pyramid.count < kSweepLevels && kept[pyramid.count].numel() > 0; ++pyramid.count) {
    const Tensor& level = kept[pyramid.count];
    pyramid.levels[pyramid.count] = {
        .pairs = reinterpret_cast<const std::uint32_t*>(level.data_ptr<std::int32_t>()),
        .width = as_int(level.size(1)),
        .height = as_int(level.size(0))};
  }
  return pyramid;
}

cuda::SweepPointers to_pointers(const SweepPictures& pictures, const SweepInput& in) {
  const std::size_t count = pictures.kept.size() / kSweepLevels;
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
                             .noise = static_cast<float>(in.noise * kUnits),
                             .patch_sigma = static_cast<float>(in.patch_sigma * kUnits),
                             .beta_d = in.medium.beta_d,
                             .beta_b = in.medium.beta_b,
                             .b_inf = in.medium.b_inf};
  for (std::size_t i = 0; i < count; ++i) {
    out.pyramids[i] = to_pyramid(&pictures.kept[i * kSweepLevels]);
  }
  for (int seen = 0; seen <= out.views; ++seen) {
    out.counted[seen] = counted_views(seen, in.best_share);
  }
  return out;
}

cuda::GraphPointers to_pointers(const BeliefInput& in) {
  TORCH_CHECK(in.cost.size(1) <= cuda::kMostLabels, "depth: ", in.cost.size(1), " hypotheses; ",
              cuda::kMostLabels, " can be told apart on a GPU");
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

  SweepPictures prepare(const std::vector<Tensor>& greys) const override {
    if (greys.empty()) return {};
    const c10::cuda::CUDAGuard guard(greys.front().device());
    return {.kept = Pyramids(greys).reduced()};
  }

  SweepOutput sweep(const SweepPictures& pictures, const SweepInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.points.device());
    const auto options = input.points.options();
    const std::vector<std::int64_t> shape = {input.points.size(0), input.inverse_depths.size(1)};
    SweepOutput out = {.cost = torch::empty(shape, options),
                       .views = torch::empty(shape, options.dtype(torch::kUInt8))};
    C10_CUDA_CHECK(cuda::launch_sweep(to_pointers(pictures, input), out.cost.data_ptr<float>(),
                                      out.views.data_ptr<std::uint8_t>(),
                                      at::cuda::getCurrentCUDAStream()));
    return out;
  }

  Tensor propagate(const BeliefInput& input) const override {
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

  Surfaces surfaces(const SurfaceInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.points.device());
    Surfaces out = {.agreement = torch::empty_like(input.inverse_depths),
                    .slope = torch::empty_like(input.points)};
    C10_CUDA_CHECK(cuda::launch_surfaces({.nodes = as_int(input.inverse_depths.size(0)),
                                          .inverse_depths = input.inverse_depths.data_ptr<float>(),
                                          .places = input.points.data_ptr<float>(),
                                          .offsets = input.offsets.data_ptr<std::int32_t>(),
                                          .neighbors = input.neighbors.data_ptr<std::int32_t>(),
                                          .same = input.same,
                                          .steepest = input.steepest,
                                          .agreement = out.agreement.data_ptr<float>(),
                                          .slope = out.slope.data_ptr<float>()},
                                         at::cuda::getCurrentCUDAStream()));
    return out;
  }

  Tensor smooth(const SmoothInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.guide.device());
    const int height = as_int(input.guide.size(0));
    const int width = as_int(input.guide.size(1));
    TORCH_CHECK(std::max(height, width) <= cuda::kLongestLine, "depth: a picture of ", width, " x ",
                height, "; at most ", cuda::kLongestLine, " px a side can be smoothed on a GPU");
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

}  // namespace apvi::mapping
