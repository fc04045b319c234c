// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/morton.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

namespace apvi::gaussians {
namespace {

using torch::Tensor;

/// Shifts and masks that insert two zeros between any two bits.
constexpr std::array<std::pair<int, std::int64_t>, 5> kSpread = {{{32, 0x1f00000000ffff},
                                                                  {16, 0x1f0000ff0000ff},
                                                                  {8, 0x100f00f00f00f00f},
                                                                  {4, 0x10c30c30c30c30c3},
                                                                  {2, 0x1249249249249249}}};

Tensor spread(Tensor bits) {
  for (const auto& [by, mask] : kSpread) {
    bits = bits.bitwise_or(bits.bitwise_left_shift(by)).bitwise_and(mask);
  }
  return bits;
}

}  // namespace

Tensor morton_codes(const Tensor& cells) {
  return spread(cells.select(1, 0))
      .bitwise_or(spread(cells.select(1, 1)).bitwise_left_shift(1))
      .bitwise_or(spread(cells.select(1, 2)).bitwise_left_shift(2));
}

Tensor morton_order(const Tensor& points) {
  TORCH_CHECK(points.dim() == 2 && points.size(1) == 3 && points.is_floating_point(),
              "morton_order: points must be floating [N,3], not ", points.sizes());
  const torch::NoGradGuard no_grad;
  if (points.size(0) == 0) return torch::empty({0}, points.options().dtype(torch::kInt64));
  const Tensor finite = torch::nan_to_num(points.detach().to(torch::kFloat64), 0.0, 0.0, 0.0);
  const Tensor low = std::get<0>(finite.min(0));
  const Tensor extent = (std::get<0>(finite.max(0)) - low).max().clamp_min(1e-300);
  const double cells = static_cast<double>((std::int64_t{1} << kMortonBits) - 1);
  const Tensor cell = ((finite - low) / extent * cells).to(torch::kInt64);
  return torch::argsort(morton_codes(cell), /*stable=*/true, /*dim=*/0, /*descending=*/false);
}

}  // namespace apvi::gaussians
