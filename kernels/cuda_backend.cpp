// SPDX-License-Identifier: BSD-3-Clause
// The one file that sees LibTorch and CUDA: it hands the memory of tensors to the launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include "apvi/splat/medium_backend.hpp"
#include "medium.hpp"

namespace apvi::splat {
namespace {

cuda::MediumPointers to_pointers(const MediumInput& in) {
  return {.pixels = in.range.numel(),
          .color = in.color.data_ptr<float>(),
          .range = in.range.data_ptr<float>(),
          .alpha = in.alpha.data_ptr<float>(),
          .beta_d = in.beta_d.data_ptr<float>(),
          .beta_b = in.beta_b.data_ptr<float>(),
          .b_inf = in.b_inf.data_ptr<float>()};
}

class CudaMediumBackend final : public MediumBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  torch::Tensor forward(const MediumInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.color.device());
    torch::Tensor image = torch::empty_like(input.color);
    C10_CUDA_CHECK(cuda::launch_medium_forward(to_pointers(input), image.data_ptr<float>(),
                                               at::cuda::getCurrentCUDAStream()));
    return image;
  }

  MediumInput backward(const MediumInput& input, const torch::Tensor& grad_image) const override {
    const c10::cuda::CUDAGuard guard(input.color.device());
    MediumInput out = {.color = torch::empty_like(input.color),
                       .range = torch::empty_like(input.range),
                       .alpha = torch::empty_like(input.alpha),
                       .beta_d = {},
                       .beta_b = {},
                       .b_inf = {}};
    const auto options = input.color.options();
    const torch::Tensor partials =
        torch::empty({cuda::kMediumScalars, cuda::kMediumBlocks}, options);
    const torch::Tensor scalars = torch::empty({3, 3}, options);
    C10_CUDA_CHECK(cuda::launch_medium_backward(to_pointers(input), grad_image.data_ptr<float>(),
                                                {.color = out.color.data_ptr<float>(),
                                                 .range = out.range.data_ptr<float>(),
                                                 .alpha = out.alpha.data_ptr<float>(),
                                                 .partials = partials.data_ptr<float>(),
                                                 .scalars = scalars.data_ptr<float>()},
                                                at::cuda::getCurrentCUDAStream()));
    out.beta_d = scalars[0];
    out.beta_b = scalars[1];
    out.b_inf = scalars[2];
    return out;
  }
};

}  // namespace

const MediumBackend& cuda_medium_backend() {
  static const CudaMediumBackend backend;
  return backend;
}

}  // namespace apvi::splat
