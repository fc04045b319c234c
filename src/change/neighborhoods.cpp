// SPDX-License-Identifier: BSD-3-Clause
#include "change/neighborhoods.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "change/surface_cells.hpp"
#include "gaussians/host_values.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

/// Keys [b,27] of blocks and their neighbors.
Tensor neighbors(const Tensor& keys) {
  std::vector<std::int64_t> steps;
  for (std::int64_t x = -1; x <= 1; ++x) {
    for (std::int64_t y = -1; y <= 1; ++y) {
      for (std::int64_t z = -1; z <= 1; ++z) steps.push_back(key_step(x, y, z));
    }
  }
  return keys.unsqueeze(1) + torch::tensor(steps, torch::kInt64).unsqueeze(0);
}

constexpr std::int64_t kGroups = 10;
constexpr double kUnchanged = 0.9;          // part of a group, at least
constexpr double kUnchangedSigmas = 1.645;  // that many deviations of a normal law contain it

/// The quantile `part` of each column [k] of values [n,k].
Tensor ranked(const Tensor& values, double part) {
  const auto rank = std::llround(part * static_cast<double>(values.size(0)));
  return std::get<0>(values.kthvalue(std::max<std::int64_t>(1, rank), 0));
}

}  // namespace

Neighborhoods::Neighborhoods(const Tensor& points, double block_m) {
  Tensor keys;
  Tensor counts;
  std::tie(keys, block_, counts) =
      torch::_unique2(cell_keys(points, block_m).to(torch::kCPU), true, true, true);
  const std::vector<Tensor> own =
      block_.argsort().split_with_sizes(gaussians::host_values<std::int64_t>(counts));
  const Tensor others = rows_of(keys, neighbors(keys).flatten()).contiguous();
  const std::int64_t* other = others.data_ptr<std::int64_t>();
  for (std::int64_t b = 0; b < keys.size(0); ++b) {
    std::vector<Tensor> parts;
    for (std::int64_t i = 27 * b; i < 27 * (b + 1); ++i) {
      if (other[i] >= 0) parts.push_back(own[static_cast<std::size_t>(other[i])]);
    }
    around_.push_back(torch::cat(parts));
  }
}

Tensor Neighborhoods::quantiles(const Tensor& values, double part) const {
  if (around_.empty()) return values;
  const Tensor host = values.to(torch::kCPU);
  std::vector<Tensor> rows;
  for (const Tensor& some : around_) {
    rows.push_back(ranked(host.index_select(0, some), part));
  }
  return torch::stack(rows).index_select(0, block_).to(values.device());
}

Tensor deviations_by_support(const Tensor& values, const Tensor& support) {
  if (values.size(0) == 0) return values;
  const Tensor order = support.to(torch::kCPU).argsort(true, 0, true);
  const Tensor sorted = values.to(torch::kCPU).abs().index_select(0, order);
  const Tensor ranked_support =
      support.to(torch::kCPU, torch::kFloat64).index_select(0, order).contiguous();
  const double* const at = ranked_support.data_ptr<double>();
  const std::int64_t n = order.size(0);
  Tensor out = torch::empty_like(sorted);
  Tensor last = torch::zeros_like(sorted[0]);
  for (std::int64_t first = 0, end = 0; first < n; first = end) {
    end = std::min(first + (n + kGroups - 1) / kGroups, n);
    while (end < n && at[end] == at[end - 1]) ++end;  // equal support is one group
    last = torch::maximum(last, ranked(sorted.slice(0, first, end), kUnchanged) / kUnchangedSigmas);
    out.index_put_({order.slice(0, first, end)}, last);
  }
  return out.to(values.device());
}

}  // namespace apvi::change
