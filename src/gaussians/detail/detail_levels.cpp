// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/detail/detail_levels.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "gaussians/detail/merging.hpp"
#include "gaussians/host_values.hpp"
#include "gaussians/model/morton.hpp"
#include "gaussians/model/rows.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr int kCoarsest = 6;  // its cells are blocks
constexpr double kReachSigmas = 3.0;
constexpr double kNear_m = 0.01;            // as far as the near plane
constexpr int kCodeBits = kMortonBits - 1;  // one bit is left for large Gaussians

Tensor largest_sigmas(const Gaussians& g) {
  return std::get<0>(g.log_scales.max(1)).exp();
}

/// Rows of the Gaussians that are finite.
Tensor finite_rows(const Gaussians& g) {
  const auto all = [](const Tensor& t) { return torch::isfinite(t).flatten(1).all(1); };
  Tensor finite = all(g.means) & all(g.log_scales) & all(g.quaternions) & all(g.sh_dc);
  if (g.sh_rest.size(1) > 0) finite = finite & all(g.sh_rest);
  return finite.nonzero().squeeze(1);
}

/// The size of most Gaussians, but no smaller than codes can tell cells apart.
double cell_width(const Tensor& means, const Tensor& sigmas) {
  const double extent =
      (std::get<0>(means.max(0)) - std::get<0>(means.min(0))).max().item<double>();
  const double smallest = extent / static_cast<double>((std::int64_t{1} << kCodeBits) - 1);
  return std::max({sigmas.median().item<double>(), smallest, 1e-9});
}

Tensor codes_of(const Tensor& means, double cell_m) {
  const Tensor cells = ((means - std::get<0>(means.min(0))) / cell_m).floor().to(torch::kInt64);
  return morton_codes(cells.clamp(0, (std::int64_t{1} << kCodeBits) - 1));
}

/// Where the Gaussians of each block begin, and the end, for blocks in order.
std::vector<std::int64_t> begins_of(const Tensor& block_of_each, const Tensor& blocks) {
  std::vector<std::int64_t> begins =
      host_values<std::int64_t>(torch::searchsorted(block_of_each, blocks));
  begins.push_back(block_of_each.size(0));
  return begins;
}

/// Gaussians in the order of the codes of their cells.
struct Coded {
  Gaussians gaussians;
  Tensor codes;  ///< [N] int64
};

Coded sorted(const Coded& in) {
  const auto [codes, order] = in.codes.sort(0);
  return {select(in.gaussians, order), codes};
}

/// The groups [N] of what is merged: those in one cell that are not large. `keys` are sorted and
/// odd for large ones.
Tensor groups_of(const Tensor& keys) {
  Tensor begins = keys.bitwise_and(1).to(torch::kBool);
  begins.slice(0, 1).logical_or_(keys.slice(0, 1) != keys.slice(0, 0, -1));
  return begins.to(torch::kInt64).cumsum(0) - begins[0].to(torch::kInt64);
}

/// The next level: one Gaussian for those in a cell of `cell_m`, twice as large as those of the
/// codes.
Coded coarser(const Coded& finer, double cell_m) {
  const Tensor cells = finer.codes.bitwise_right_shift(3);
  const Tensor is_large = largest_sigmas(finer.gaussians) > cell_m;
  const auto [keys, order] = (2 * cells + is_large.to(torch::kInt64)).sort(0);
  const Tensor group = groups_of(keys);
  const Tensor is_alone = (group.bincount() == 1).index_select(0, group);
  const auto rows_where = [](const Tensor& mask) { return mask.nonzero().squeeze(1); };
  const auto codes_at = [&keys = keys](const Tensor& rows) {
    return keys.index_select(0, rows).bitwise_right_shift(1);
  };
  const Tensor alone = rows_where(is_alone);
  Coded out{select(finer.gaussians, order.index_select(0, alone)), codes_at(alone)};
  const Tensor together = rows_where(is_alone.logical_not());
  if (together.size(0) > 0) {
    const auto [ids, members, sizes] =
        torch::unique_consecutive(group.index_select(0, together), /*return_inverse=*/true,
                                  /*return_counts=*/true);
    out.gaussians = join(
        out.gaussians,
        merged(select(finer.gaussians, order.index_select(0, together)), members, ids.size(0)));
    out.codes = torch::cat({out.codes, codes_at(together.index_select(0, sizes.cumsum(0) - 1))});
  }
  return sorted(out);
}

}  // namespace

DetailLevels::DetailLevels(const Gaussians& gaussians) {
  const torch::NoGradGuard no_grad;
  Level& finest = levels_.emplace_back();
  finest.gaussians = gaussians;
  const Tensor finite = gaussians.size() > 0 ? finite_rows(gaussians) : Tensor();
  if (!finite.defined() || finite.size(0) == 0) return;
  const Gaussians used = gaussians::select(gaussians, finite);
  const Tensor means = used.means.to(torch::kFloat64);
  cell_m_ = cell_width(means, largest_sigmas(used));
  const auto [codes, order] = codes_of(means, cell_m_).sort(0);
  const Tensor block_of_each = codes.bitwise_right_shift(3 * kCoarsest);
  const Tensor blocks = std::get<0>(torch::unique_consecutive(block_of_each));
  finest.rows = host_values<std::int64_t>(finite.index_select(0, order));
  finest.begins = begins_of(block_of_each, blocks);
  Coded coded{gaussians::select(used, order), codes};
  set_blocks(coded.gaussians);
  for (int k = 1; k <= kCoarsest; ++k) {
    coded = coarser(coded, std::ldexp(cell_m_, k));
    const Tensor of_each = coded.codes.bitwise_right_shift(3 * (kCoarsest - k));
    levels_.push_back({coded.gaussians, {}, begins_of(of_each, blocks)});
  }
}

void DetailLevels::set_blocks(const Gaussians& ordered) {
  const Tensor means = ordered.means.to(torch::kCPU, torch::kFloat64).contiguous();
  const Tensor sigmas = largest_sigmas(ordered).to(torch::kCPU, torch::kFloat64).contiguous();
  const auto p = means.accessor<double, 2>();
  const auto sigma = sigmas.accessor<double, 1>();
  const std::vector<std::int64_t>& begins = levels_.front().begins;
  for (std::size_t b = 0; b + 1 < begins.size(); ++b) {
    Block block;
    const auto count = static_cast<double>(begins[b + 1] - begins[b]);
    for (std::int64_t i = begins[b]; i < begins[b + 1]; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        block.means.center[k] += p[i][static_cast<std::int64_t>(k)] / count;
      }
      block.reach_m = std::max(block.reach_m, kReachSigmas * sigma[i]);
    }
    const auto& [x, y, z] = block.means.center;
    for (std::int64_t i = begins[b]; i < begins[b + 1]; ++i) {
      const double distance_m = std::hypot(p[i][0] - x, p[i][1] - y, p[i][2] - z);
      block.means.radius_m = std::max(block.means.radius_m, distance_m);
    }
    blocks_.push_back(block);
  }
}

std::vector<std::int64_t> DetailLevels::sizes() const {
  std::vector<std::int64_t> sizes;
  for (const Level& level : levels_) {
    sizes.push_back(level.begins.empty() ? 0 : level.begins.back());
  }
  return sizes;
}

Gaussians DetailLevels::at_most(std::int64_t count) const {
  for (const Level& level : levels_) {
    if (level.gaussians.size() <= count) return level.gaussians;
  }
  return levels_.back().gaussians;
}

std::size_t DetailLevels::level_for(const Intrinsics& camera, const Sphere& in_camera,
                                    double max_cell_px) const {
  const auto& [x, y, z] = in_camera.center;
  const double nearest_m = std::max(kNear_m, std::hypot(x, y, z) - in_camera.radius_m);
  const double cell_px = std::max(camera.fx, camera.fy) * cell_m_ / nearest_m;
  const double finer_by = std::floor(std::log2(max_cell_px / cell_px));
  return static_cast<std::size_t>(std::clamp(finer_by, 0.0, static_cast<double>(kCoarsest)));
}

Gaussians DetailLevels::select(const View& view, double max_cell_px) const {
  const torch::NoGradGuard no_grad;
  std::vector<std::vector<std::int64_t>> rows(levels_.size());
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    const Sphere means = to_camera(view.T_camera_world, blocks_[b].means);
    const Sphere whole{means.center, means.radius_m + blocks_[b].reach_m};
    if (!may_see(view.intrinsics, whole, std::numeric_limits<double>::infinity())) continue;
    const std::size_t k = level_for(view.intrinsics, means, max_cell_px);
    const Level& level = levels_[k];
    for (std::int64_t i = level.begins[b]; i < level.begins[b + 1]; ++i) {
      rows[k].push_back(level.rows.empty() ? i : level.rows[static_cast<std::size_t>(i)]);
    }
  }
  // Copies cost more than Gaussians outside of the view.
  const bool is_finest = std::all_of(rows.begin() + 1, rows.end(),
                                     [](const auto& of_level) { return of_level.empty(); });
  if (is_finest && 2 * rows.front().size() > levels_.front().rows.size()) {
    return levels_.front().gaussians;
  }
  std::vector<Gaussians> parts;
  for (std::size_t k = 0; k < levels_.size(); ++k) {
    const Gaussians& level = levels_[k].gaussians;
    if (rows[k].empty() && k > 0) continue;
    const Tensor index = torch::tensor(rows[k], torch::kInt64).to(level.means.device());
    parts.push_back(gaussians::select(level, index));
  }
  return join(parts);
}

}  // namespace apvi::gaussians
