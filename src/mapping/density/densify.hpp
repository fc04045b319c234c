// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "apvi/mapping/options.hpp"
#include "gaussians/model/gaussian_store.hpp"
#include "gaussians/render/render.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Per-Gaussian statistics over views: since the last round, and for the importance since
/// insertion.
class DensityStatistics {
 public:
  explicit DensityStatistics(std::int64_t count, const torch::Device& device = torch::kCPU);

  std::int64_t size() const { return gradient_sum_.size(0); }
  /// Whether all tensors have `count` entries; false after a change that ran out of memory.
  bool has_size(std::int64_t count) const;
  void to(const torch::Device& device);
  /// Starts a new round: merges the current statistics into the importance and resets them.
  void begin_round();
  /// Adds a view's statistics, after its backward pass.
  void observe(const gaussians::RenderStatistics& statistics);
  /// Appends `count` new Gaussians, of the given importance [count] or one.
  void extend(std::int64_t count, const torch::Tensor& importance = {});
  /// Keeps the Gaussians where `which` [size()] (bool) is set.
  void keep(const torch::Tensor& which);
  /// Permutes: entry i becomes that of Gaussian order[i] [size()] (int64).
  void reorder(const torch::Tensor& order);
  /// Mean gradient norm of the projected mean over the views that saw it, [N]; 0 if none did.
  torch::Tensor mean_gradient() const { return gradient_sum_ / views_.clamp_min(1.0); }
  /// Number of views that saw it [N], and its largest blend weight there [N].
  const torch::Tensor& views() const { return views_; }
  const torch::Tensor& max_weight() const { return max_weight_; }
  /// Largest blend weight in any view [N], decayed by 2 % per later view that saw it; initially
  /// one. The least important Gaussians are pruned first (Niemeyer et al., "RadSplat", 2024, use
  /// the maximum over all views).
  torch::Tensor importance() const;

  void save(torch::serialize::OutputArchive& archive) const;
  /// Loads to the CPU.
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor gradient_sum_, views_, max_weight_;  // [N] float32
  torch::Tensor importance_;                         // at the start of the round
};

struct DensifyResult {
  std::int64_t cloned = 0;
  std::int64_t split = 0;
  std::int64_t pruned = 0;
};

/// One round of densification and pruning. Where the mean gradient is above the threshold, small
/// Gaussians are cloned (with opacities that keep the total transmittance; Bulò et al., "Revising
/// densification in Gaussian splatting", 2024) and large ones are split into two of 1/1.6 of the
/// size, sampled from them (Kerbl et al., 2023); largest gradients first, up to `limit` Gaussians.
/// Transparent, too large and unused Gaussians are pruned. `statistics` are updated accordingly.
/// Deterministic for a given `seed`.
DensifyResult densify(gaussians::GaussianStore& store, DensityStatistics& statistics,
                      const DensifyOptions& options, double extent, std::int64_t limit,
                      std::uint64_t seed);

/// Gaussians that `densify` prunes [N] bool.
torch::Tensor prune_mask(const gaussians::Gaussians& gaussians, const DensityStatistics& statistics,
                         const DensifyOptions& options, double extent);

}  // namespace apvi::mapping
