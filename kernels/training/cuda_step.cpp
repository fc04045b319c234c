// SPDX-License-Identifier: BSD-3-Clause
// Passes tensor memory to the training step launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include "kernels/training/step.hpp"
#include "mapping/training/step_backend.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

int as_int(std::int64_t value) {
  return static_cast<int>(value);
}

/// Memory of one depth curvature loss: saved values first, then scratch.
cuda::CurvaturePointers to_pointers(const Tensor& depth, const Tensor& memory) {
  const std::int64_t pixels = depth.numel();
  float* const saved = memory.data_ptr<float>();
  return {.width = as_int(depth.size(1)),
          .height = as_int(depth.size(0)),
          .depth = depth.data_ptr<float>(),
          .alpha = nullptr,
          .image = nullptr,
          .inverse = saved,
          .gradients = saved + pixels,
          .factor = saved + 3 * pixels,
          .gray = nullptr,
          .partials = nullptr};
}

struct DepthCurvatureLoss : torch::autograd::Function<DepthCurvatureLoss> {
  static Tensor forward(AutogradContext* context, const Tensor& depth, const Tensor& alpha,
                        const Tensor& image) {
    const c10::cuda::CUDAGuard guard(depth.device());
    const std::int64_t pixels = depth.numel();
    const Tensor memory = torch::empty({3 * pixels + 1}, depth.options());
    const Tensor scratch =
        torch::empty({pixels + 2 * cuda::kStepBlocks * cuda::kCurvatureSums}, depth.options());
    Tensor loss = torch::empty({}, depth.options());
    cuda::CurvaturePointers pointers = to_pointers(depth, memory);
    pointers.alpha = alpha.data_ptr<float>();
    pointers.image = image.data_ptr<float>();
    pointers.gray = scratch.data_ptr<float>();
    pointers.partials = pointers.gray + pixels;
    C10_CUDA_CHECK(cuda::launch_depth_curvature_loss(pointers, loss.data_ptr<float>(),
                                                     at::cuda::getCurrentCUDAStream()));
    context->save_for_backward({depth, memory});
    return loss;
  }

  static variable_list backward(AutogradContext* context, const variable_list& grads) {
    const variable_list saved = context->get_saved_variables();
    const c10::cuda::CUDAGuard guard(saved[0].device());
    Tensor gradient = torch::empty_like(saved[0]);
    const Tensor grad_loss = grads[0].contiguous();
    C10_CUDA_CHECK(cuda::launch_depth_curvature_loss_backward(
        to_pointers(saved[0], saved[1]), grad_loss.data_ptr<float>(), gradient.data_ptr<float>(),
        at::cuda::getCurrentCUDAStream()));
    return {gradient, Tensor(), Tensor()};
  }
};

class CudaStepBackend final : public StepBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  Tensor target(const TargetInput& in) const override {
    const c10::cuda::CUDAGuard guard(in.image.device());
    const Tensor image = in.image.contiguous();
    const std::int64_t height = image.size(0) / in.reduction;
    const std::int64_t width = image.size(1) / in.reduction;
    Tensor target = torch::empty({height, width, 3}, image.options().dtype(torch::kFloat32));
    C10_CUDA_CHECK(cuda::launch_target(
        {.image = image.data_ptr<std::uint8_t>(),
         .full_width = as_int(image.size(1)),
         .width = as_int(width),
         .height = as_int(height),
         .reduction = in.reduction,
         .falloff = in.falloff.defined() ? in.falloff.data_ptr<float>() : nullptr,
         .log_gain = in.log_gain.defined() ? in.log_gain.data_ptr<float>() : nullptr,
         .light = in.light.defined() ? in.light.data_ptr<float>() : nullptr},
        target.data_ptr<float>(), at::cuda::getCurrentCUDAStream()));
    return target;
  }

  void match_gain(const GainInput& in) const override {
    const c10::cuda::CUDAGuard guard(in.drawn.device());
    const Tensor drawn = in.drawn.contiguous();
    const Tensor alpha = in.alpha.contiguous();
    const Tensor image = in.image.contiguous();
    const Tensor partials =
        torch::empty({cuda::kStepBlocks * cuda::kGainSums}, drawn.options().requires_grad(false));
    const Tensor water = in.water.defined() ? in.water.contiguous() : Tensor();
    C10_CUDA_CHECK(
        cuda::launch_match_gain({.width = as_int(alpha.size(1)),
                                 .height = as_int(alpha.size(0)),
                                 .rendered = drawn.data_ptr<float>(),
                                 .alpha = alpha.data_ptr<float>(),
                                 .image = image.data_ptr<float>(),
                                 .water = water.defined() ? water.data_ptr<float>() : nullptr,
                                 .across = in.horizon[0],
                                 .down = in.horizon[1],
                                 .offset = in.horizon[2],
                                 .step_size = static_cast<float>(in.update.step_size),
                                 .max_change = static_cast<float>(in.update.max_change),
                                 .decay = static_cast<float>(in.update.decay),
                                 .bias_rate = static_cast<float>(in.update.bias_rate),
                                 .partials = partials.data_ptr<float>()},
                                in.log_gain.data_ptr<float>(), in.bias.data_ptr<float>(),
                                at::cuda::getCurrentCUDAStream()));
  }

  Tensor classify_water(const Tensor& image, const Tensor& water) const override {
    const c10::cuda::CUDAGuard guard(image.device());
    const Tensor shown = image.contiguous();
    const Tensor veiling_light = water.contiguous();
    Tensor kinds =
        torch::empty({shown.size(0), shown.size(1)}, shown.options().dtype(torch::kInt8));
    C10_CUDA_CHECK(cuda::launch_classify_water({.width = as_int(shown.size(1)),
                                                .height = as_int(shown.size(0)),
                                                .image = shown.data_ptr<float>(),
                                                .water = veiling_light.data_ptr<float>(),
                                                .kinds = kinds.data_ptr<std::int8_t>()},
                                               at::cuda::getCurrentCUDAStream()));
    return kinds;
  }

  Tensor opacity_loss_gradient(const Tensor& image, const Tensor& water, const Tensor& alpha,
                               const OpacityWeights& weights) const override {
    const Tensor kinds = classify_water(image, water);
    const c10::cuda::CUDAGuard guard(image.device());
    const Tensor drawn = alpha.contiguous();
    Tensor gradient = torch::empty_like(drawn);
    C10_CUDA_CHECK(
        cuda::launch_opacity_loss_gradient({.width = as_int(kinds.size(1)),
                                            .height = as_int(kinds.size(0)),
                                            .kinds = kinds.data_ptr<std::int8_t>(),
                                            .alpha = drawn.data_ptr<float>(),
                                            .open = static_cast<float>(weights.open),
                                            .edge = static_cast<float>(weights.edge),
                                            .surface = static_cast<float>(weights.surface),
                                            .gradient = gradient.data_ptr<float>()},
                                           at::cuda::getCurrentCUDAStream()));
    return gradient;
  }

  void observe(const gaussians::RenderStatistics& statistics,
               const DensitySums& sums) const override {
    const c10::cuda::CUDAGuard guard(sums.views.device());
    const Tensor visible = statistics.visible.contiguous();
    const Tensor gradient = statistics.mean2d_gradient.contiguous();
    const Tensor weight = statistics.max_weight.contiguous();
    C10_CUDA_CHECK(cuda::launch_observe({.count = sums.views.size(0),
                                         .visible = visible.data_ptr<bool>(),
                                         .gradient = gradient.data_ptr<float>(),
                                         .weight = weight.data_ptr<float>(),
                                         .gradient_sum = sums.gradient.data_ptr<float>(),
                                         .views = sums.views.data_ptr<float>(),
                                         .max_weight = sums.max_weight.data_ptr<float>()},
                                        at::cuda::getCurrentCUDAStream()));
  }

  Tensor depth_curvature_loss(const Tensor& depth, const Tensor& alpha,
                              const Tensor& image) const override {
    return DepthCurvatureLoss::apply(depth.contiguous(), alpha.contiguous(), image.contiguous());
  }
};

}  // namespace

const StepBackend& cuda_step_backend() {
  static const CudaStepBackend backend;
  return backend;
}

}  // namespace apvi::mapping
