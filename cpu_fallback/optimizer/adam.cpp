// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "cpu_fallback/optimizer/adam_kernel.hpp"
#include "gaussians/optimizer/adam_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

// Values per block. Threads take whole blocks, so that vectorization remainders do not depend on
// the number of threads.
constexpr std::int64_t kBlock = 16384;

template <typename T>
cpu::AdamFactors<T> factors(const AdamOptions& options, double rate, std::int64_t steps) {
  const auto n = static_cast<double>(steps);
  return {.beta1 = static_cast<T>(options.beta1),
          .beta2 = static_cast<T>(options.beta2),
          .rate = static_cast<T>(rate / (1.0 - std::pow(options.beta1, n))),
          .root_scale = static_cast<T>(1.0 / std::sqrt(1.0 - std::pow(options.beta2, n))),
          .epsilon = static_cast<T>(options.epsilon)};
}

template <typename T>
cpu::AdamPointers<T> pointers(const AdamGroup& group) {
  return {group.parameter.data_ptr<T>(), group.gradient.data_ptr<T>(), group.first.data_ptr<T>(),
          group.second.data_ptr<T>()};
}

template <typename T>
void step_all(const AdamGroup& group, const cpu::AdamFactors<T>& f) {
  const cpu::AdamPointers<T> p = pointers<T>(group);
  const std::int64_t values = group.parameter.numel();
  const std::int64_t blocks = (values + kBlock - 1) / kBlock;
  at::parallel_for(0, blocks, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t b = begin; b < end; ++b) {
      cpu::adam_values(p, f, b * kBlock, std::min((b + 1) * kBlock, values));
    }
  });
}

template <typename T>
void step_visible(const AdamGroup& group, const cpu::AdamFactors<T>& f, const bool* visible) {
  const cpu::AdamPointers<T> p = pointers<T>(group);
  const std::int64_t rows = group.parameter.size(0);
  const std::int64_t width = rows == 0 ? 0 : group.parameter.numel() / rows;
  at::parallel_for(0, rows, kBlock / 16, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t row = begin; row < end; ++row) {
      if (visible[row]) cpu::adam_values(p, f, row * width, (row + 1) * width);
    }
  });
}

class CpuAdamBackend final : public AdamBackend {
 public:
  std::string_view name() const override { return "cpu"; }

  void step(const std::vector<AdamGroup>& groups, std::int64_t steps, const AdamOptions& options,
            const Tensor& visible) const override {
    for (const AdamGroup& group : groups) {
      AT_DISPATCH_FLOATING_TYPES(group.parameter.scalar_type(), "adam", [&] {
        const auto f = factors<scalar_t>(options, group.rate, steps);
        if (visible.defined()) {
          step_visible(group, f, visible.data_ptr<bool>());
        } else {
          step_all(group, f);
        }
      });
    }
  }
};

}  // namespace

const AdamBackend& cpu_adam_backend() {
  static const CpuAdamBackend backend;
  return backend;
}

}  // namespace apvi::gaussians
