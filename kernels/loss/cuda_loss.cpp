// SPDX-License-Identifier: BSD-3-Clause
// Passes tensor memory to the photometric loss launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include "gaussians/metrics/loss_backend.hpp"
#include "kernels/loss/loss.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

class CudaLossBackend final : public LossBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  LossOutput forward(const LossInput& input, bool needs_backward) const override {
    const c10::cuda::CUDAGuard guard(input.image.device());
    const auto options = input.image.options();
    const cuda::LossImages images = to_images(input);
    const std::int64_t blocks = cuda::loss_blocks(images.width, images.height);
    const std::int64_t saved = needs_backward ? cuda::kLossMaps * input.image.numel() : 0;
    LossOutput out = {.loss = torch::empty({}, options),
                      .saved = torch::empty({saved + 1}, options)};
    const Tensor partials = torch::empty({blocks, 3}, options);
    auto* const inv_count = out.saved.data_ptr<float>();
    C10_CUDA_CHECK(cuda::launch_loss_forward(images, needs_backward ? inv_count + 1 : nullptr,
                                             partials.data_ptr<float>(), out.loss.data_ptr<float>(),
                                             inv_count, at::cuda::getCurrentCUDAStream()));
    if (!needs_backward) out.saved = Tensor();
    return out;
  }

  Tensor backward(const LossInput& input, const Tensor& saved,
                  const Tensor& grad_loss) const override {
    const c10::cuda::CUDAGuard guard(input.image.device());
    Tensor gradient = torch::empty_like(input.image);
    const auto* const inv_count = saved.data_ptr<float>();
    C10_CUDA_CHECK(cuda::launch_loss_backward(
        to_images(input), inv_count + 1, inv_count, grad_loss.data_ptr<float>(),
        gradient.data_ptr<float>(), at::cuda::getCurrentCUDAStream()));
    return gradient;
  }

 private:
  static cuda::LossImages to_images(const LossInput& in) {
    return {.width = static_cast<int>(in.image.size(1)),
            .height = static_cast<int>(in.image.size(0)),
            .image = in.image.data_ptr<float>(),
            .target = in.target.data_ptr<float>(),
            .valid = in.valid.defined() ? in.valid.data_ptr<float>() : nullptr,
            .ssim_weight = static_cast<float>(in.ssim_weight)};
  }
};

}  // namespace

const LossBackend& cuda_loss_backend() {
  static const CudaLossBackend backend;
  return backend;
}

}  // namespace apvi::gaussians
