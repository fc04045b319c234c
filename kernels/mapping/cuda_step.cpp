// SPDX-License-Identifier: BSD-3-Clause
// Training steps' file that sees LibTorch and CUDA: it hands the memory of tensors to the
// launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include "apvi/mapping/step_backend.hpp"
#include "step.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

int as_int(std::int64_t value) {
  return static_cast<int>(value);
}

/// Memory of one bentness: what is kept for the derivative, then what is not.
cuda::BendPointers to_pointers(const Tensor& depth, const Tensor& memory) {
  const std::int64_t pixels = depth.numel();
  float* const kept = memory.data_ptr<float>();
  return {.width = as_int(depth.size(1)),
          .height = as_int(depth.size(0)),
          .depth = depth.data_ptr<float>(),
          .alpha = nullptr,
          .picture = nullptr,
          .inverse = kept,
          .pulls = kept + pixels,
          .factor = kept + 3 * pixels,
          .grey = nullptr,
          .partials = nullptr};
}

struct Bentness : torch::autograd::Function<Bentness> {
  static Tensor forward(AutogradContext* context, const Tensor& depth, const Tensor& alpha,
                        const Tensor& picture) {
    const c10::cuda::CUDAGuard guard(depth.device());
    const std::int64_t pixels = depth.numel();
    const Tensor memory = torch::empty({3 * pixels + 1}, depth.options());
    const Tensor scratch =
        torch::empty({pixels + 2 * cuda::kStepBlocks * cuda::kBendSums}, depth.options());
    Tensor bent = torch::empty({}, depth.options());
    cuda::BendPointers pointers = to_pointers(depth, memory);
    pointers.alpha = alpha.data_ptr<float>();
    pointers.picture = picture.data_ptr<float>();
    pointers.grey = scratch.data_ptr<float>();
    pointers.partials = pointers.grey + pixels;
    C10_CUDA_CHECK(
        cuda::launch_bend(pointers, bent.data_ptr<float>(), at::cuda::getCurrentCUDAStream()));
    context->save_for_backward({depth, memory});
    return bent;
  }

  static variable_list backward(AutogradContext* context, const variable_list& grads) {
    const variable_list saved = context->get_saved_variables();
    const c10::cuda::CUDAGuard guard(saved[0].device());
    Tensor gradient = torch::empty_like(saved[0]);
    const Tensor by_bent = grads[0].contiguous();
    C10_CUDA_CHECK(cuda::launch_bend_backward(to_pointers(saved[0], saved[1]),
                                              by_bent.data_ptr<float>(), gradient.data_ptr<float>(),
                                              at::cuda::getCurrentCUDAStream()));
    return {gradient, Tensor(), Tensor()};
  }
};

class CudaStepBackend final : public StepBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  Tensor target(const TargetInput& in) const override {
    const c10::cuda::CUDAGuard guard(in.picture.device());
    const Tensor picture = in.picture.contiguous();
    const std::int64_t height = picture.size(0) / in.reduction;
    const std::int64_t width = picture.size(1) / in.reduction;
    Tensor target = torch::empty({height, width, 3}, picture.options().dtype(torch::kFloat32));
    C10_CUDA_CHECK(cuda::launch_target(
        {.picture = picture.data_ptr<std::uint8_t>(),
         .full_width = as_int(picture.size(1)),
         .width = as_int(width),
         .height = as_int(height),
         .reduction = in.reduction,
         .falloff = in.falloff.defined() ? in.falloff.data_ptr<float>() : nullptr,
         .log_gain = in.log_gain.defined() ? in.log_gain.data_ptr<float>() : nullptr},
        target.data_ptr<float>(), at::cuda::getCurrentCUDAStream()));
    return target;
  }

  void match_gain(const GainInput& in) const override {
    const c10::cuda::CUDAGuard guard(in.drawn.device());
    const Tensor drawn = in.drawn.contiguous();
    const Tensor alpha = in.alpha.contiguous();
    const Tensor picture = in.picture.contiguous();
    const Tensor partials =
        torch::empty({cuda::kStepBlocks * cuda::kGainSums}, drawn.options().requires_grad(false));
    const Tensor water = in.water.defined() ? in.water.contiguous() : Tensor();
    C10_CUDA_CHECK(
        cuda::launch_match_gain({.width = as_int(alpha.size(1)),
                                 .height = as_int(alpha.size(0)),
                                 .drawn = drawn.data_ptr<float>(),
                                 .alpha = alpha.data_ptr<float>(),
                                 .picture = picture.data_ptr<float>(),
                                 .water = water.defined() ? water.data_ptr<float>() : nullptr,
                                 .across = in.horizon[0],
                                 .down = in.horizon[1],
                                 .offset = in.horizon[2],
                                 .share = static_cast<float>(in.pace.share),
                                 .most = static_cast<float>(in.pace.most),
                                 .forgets = static_cast<float>(in.pace.forgets),
                                 .learns = static_cast<float>(in.pace.learns),
                                 .partials = partials.data_ptr<float>()},
                                in.log_gain.data_ptr<float>(), in.usual.data_ptr<float>(),
                                at::cuda::getCurrentCUDAStream()));
  }

  Tensor water_kinds(const Tensor& picture, const Tensor& water) const override {
    const c10::cuda::CUDAGuard guard(picture.device());
    const Tensor shown = picture.contiguous();
    const Tensor veil = water.contiguous();
    Tensor kinds =
        torch::empty({shown.size(0), shown.size(1)}, shown.options().dtype(torch::kInt8));
    C10_CUDA_CHECK(cuda::launch_water_kinds({.width = as_int(shown.size(1)),
                                             .height = as_int(shown.size(0)),
                                             .picture = shown.data_ptr<float>(),
                                             .water = veil.data_ptr<float>(),
                                             .kinds = kinds.data_ptr<std::int8_t>()},
                                            at::cuda::getCurrentCUDAStream()));
    return kinds;
  }

  Tensor opacity_pull(const Tensor& picture, const Tensor& water, const Tensor& alpha,
                      const OpacityWeights& weights) const override {
    const Tensor kinds = water_kinds(picture, water);
    const c10::cuda::CUDAGuard guard(picture.device());
    const Tensor drawn = alpha.contiguous();
    Tensor pull = torch::empty_like(drawn);
    C10_CUDA_CHECK(cuda::launch_opacity_pull({.width = as_int(kinds.size(1)),
                                              .height = as_int(kinds.size(0)),
                                              .kinds = kinds.data_ptr<std::int8_t>(),
                                              .alpha = drawn.data_ptr<float>(),
                                              .open = static_cast<float>(weights.open),
                                              .edge = static_cast<float>(weights.edge),
                                              .surface = static_cast<float>(weights.surface),
                                              .pull = pull.data_ptr<float>()},
                                             at::cuda::getCurrentCUDAStream()));
    return pull;
  }

  void observe(const splat::RenderStatistics& statistics, const SeenSums& sums) const override {
    const c10::cuda::CUDAGuard guard(sums.views.device());
    const Tensor visible = statistics.visible.contiguous();
    const Tensor pull = statistics.mean2d_gradient.contiguous();
    const Tensor weight = statistics.max_weight.contiguous();
    C10_CUDA_CHECK(cuda::launch_observe({.count = sums.views.size(0),
                                         .visible = visible.data_ptr<bool>(),
                                         .pull = pull.data_ptr<float>(),
                                         .weight = weight.data_ptr<float>(),
                                         .gradient_sum = sums.gradient.data_ptr<float>(),
                                         .views = sums.views.data_ptr<float>(),
                                         .max_weight = sums.max_weight.data_ptr<float>()},
                                        at::cuda::getCurrentCUDAStream()));
  }

  Tensor bentness(const Tensor& depth, const Tensor& alpha, const Tensor& picture) const override {
    return Bentness::apply(depth.contiguous(), alpha.contiguous(), picture.contiguous());
  }
};

}  // namespace

const StepBackend& cuda_step_backend() {
  static const CudaStepBackend backend;
  return backend;
}

}  // namespace apvi::mapping
