// SPDX-License-Identifier: BSD-3-Clause
#include "change/clusters.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <unordered_map>

#include "change/surface_cells.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;
using Rows = std::unordered_map<std::int64_t, std::int64_t>;  // by key

constexpr std::int64_t kReach = 2;  // [cells]

std::vector<std::int64_t> steps(std::int64_t reach) {
  std::vector<std::int64_t> out;
  for (std::int64_t x = -reach; x <= reach; ++x) {
    for (std::int64_t y = -reach; y <= reach; ++y) {
      for (std::int64_t z = -reach; z <= reach; ++z) out.push_back(key_step(x, y, z));
    }
  }
  return out;
}

Rows rows_where(const Tensor& keys, const Tensor& which) {
  const Tensor rows = which.nonzero().squeeze(1).to(torch::kCPU).contiguous();
  const Tensor found = keys.to(torch::kCPU).index_select(0, rows).contiguous();
  Rows out;
  for (std::int64_t i = 0; i < rows.size(0); ++i) {
    out.emplace(found.data_ptr<std::int64_t>()[i], rows.data_ptr<std::int64_t>()[i]);
  }
  return out;
}

/// Takes everything within reach of a cell out of `open` and appends it.
void take(Rows& open, std::int64_t key, const std::vector<std::int64_t>& around,
          std::vector<std::int64_t>& keys, std::vector<std::int64_t>& rows) {
  for (const std::int64_t step : around) {
    const auto found = open.find(key + step);
    if (found == open.end()) continue;
    keys.push_back(found->first);
    rows.push_back(found->second);
    open.erase(found);
  }
}

}  // namespace

std::vector<std::vector<std::int64_t>> clusters(const Tensor& keys, const Tensor& strong,
                                                const Tensor& weak) {
  Rows open = rows_where(keys, strong);
  Rows edge = rows_where(keys, weak & ~strong);
  const std::vector<std::int64_t> around = steps(kReach);
  std::vector<std::vector<std::int64_t>> out;
  while (!open.empty()) {
    std::vector<std::int64_t> members = {open.begin()->first};
    std::vector<std::int64_t> rows = {open.begin()->second};
    open.erase(open.begin());
    for (std::size_t i = 0; i < members.size(); ++i) take(open, members[i], around, members, rows);
    const std::size_t inner = members.size();
    for (std::size_t i = 0; i < inner; ++i) take(edge, members[i], around, members, rows);
    std::sort(rows.begin(), rows.end());
    out.push_back(std::move(rows));
  }
  std::sort(out.begin(), out.end());
  return out;
}

Extent extent_of(const Tensor& points, double cell_m) {
  const Tensor p = points.to(torch::kCPU, torch::kFloat64);
  const Tensor centered = p - p.mean(0);
  const Tensor axes = std::get<1>(torch::linalg_eigh(centered.t().mm(centered))).slice(1, 1, 3);
  const Tensor flat = centered.mm(axes);
  const Tensor extent = std::get<0>(flat.max(0)) - std::get<0>(flat.min(0)) + cell_m;
  const Tensor columns = torch::cat({flat, torch::zeros_like(flat.slice(1, 0, 1))}, 1);
  const auto used = std::get<0>(torch::_unique2(cell_keys(columns, cell_m))).size(0);
  return {extent.max().item<double>(), extent.min().item<double>(),
          static_cast<double>(used) * cell_m * cell_m};
}

}  // namespace apvi::change
