// SPDX-License-Identifier: BSD-3-Clause
// Passes tensor memory to the optimizer launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "gaussians/optimizer/adam_backend.hpp"
#include "kernels/optimizer/adam.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

class CudaAdamBackend final : public AdamBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  void step(const std::vector<AdamGroup>& groups, std::int64_t steps, const AdamOptions& options,
            const Tensor& visible) const override {
    const c10::cuda::CUDAGuard guard(groups.front().parameter.device());
    const cuda::AdamFactors factors = to_factors(steps, options);
    const std::vector<cuda::AdamGroupPointers> pointers = to_pointers(groups, steps, options);
    const bool* const mask = visible.defined() ? visible.data_ptr<bool>() : nullptr;
    for (std::size_t k = 0; k < pointers.size(); k += cuda::kMaxAdamGroups) {
      const std::size_t count = std::min<std::size_t>(cuda::kMaxAdamGroups, pointers.size() - k);
      C10_CUDA_CHECK(cuda::launch_adam(pointers.data() + k, static_cast<int>(count), factors, mask,
                                       at::cuda::getCurrentCUDAStream()));
    }
  }

  void step_sparse(const std::vector<AdamGroup>& groups, const SparseGradient& gradient,
                   std::int64_t steps, const AdamOptions& options,
                   bool visible_only) const override {
    const c10::cuda::CUDAGuard guard(gradient.row.device());
    C10_CUDA_CHECK(cuda::launch_adam_sparse(
        to_pointers(groups, steps, options).data(), gradient.row.size(0),
        {.row = gradient.row.data_ptr<std::int32_t>(),
         .rows = gradient.values.data_ptr<float>(),
         .sh_degree = gradient.sh_degree},
        to_factors(steps, options), visible_only, at::cuda::getCurrentCUDAStream()));
  }

 private:
  static cuda::AdamFactors to_factors(std::int64_t steps, const AdamOptions& options) {
    const auto n = static_cast<double>(steps);
    return {.beta1 = static_cast<float>(options.beta1),
            .beta2 = static_cast<float>(options.beta2),
            .root_scale = static_cast<float>(1.0 / std::sqrt(1.0 - std::pow(options.beta2, n))),
            .epsilon = static_cast<float>(options.epsilon),
            .seed = static_cast<unsigned>(steps) * 0x9e3779b9U};
  }

  static std::vector<cuda::AdamGroupPointers> to_pointers(const std::vector<AdamGroup>& groups,
                                                          std::int64_t steps,
                                                          const AdamOptions& options) {
    const double scale = 1.0 / (1.0 - std::pow(options.beta1, static_cast<double>(steps)));
    std::vector<cuda::AdamGroupPointers> out;
    for (const AdamGroup& group : groups) {
      const std::int64_t values = group.parameter.numel();
      const std::int64_t rows = group.parameter.dim() == 0 ? 1 : group.parameter.size(0);
      const Tensor& gradient = group.gradient;
      out.push_back({.values = values,
                     .width = rows == 0 ? 0 : values / rows,
                     .parameter = group.parameter.data_ptr<float>(),
                     .gradient = gradient.defined() ? gradient.data_ptr<float>() : nullptr,
                     .first = group.first.data_ptr(),
                     .second = group.second.data_ptr(),
                     .is_bf16 = group.first.scalar_type() == torch::kBFloat16,
                     .rate = static_cast<float>(group.rate * scale)});
    }
    return out;
  }
};

}  // namespace

const AdamBackend& cuda_adam_backend() {
  static const CudaAdamBackend backend;
  return backend;
}

}  // namespace apvi::gaussians
