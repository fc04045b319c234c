// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "apvi/mapping/options.hpp"
#include "apvi/splat/gaussian_store.hpp"
#include "apvi/splat/render.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// What views say about each Gaussian: those since the last round, and for its importance all.
class DensityStatistics {
 public:
  explicit DensityStatistics(std::int64_t count, const torch::Device& device = torch::kCPU);

  std::int64_t size() const { return gradient_sum_.size(0); }
  /// False of other than `count` Gaussians, and where memory ended in the middle of a change.
  bool is_of(std::int64_t count) const;
  void to(const torch::Device& device);
  /// From now on what views say counts for the next round; what they said goes into importance.
  void begin_round();
  /// Takes in a view's statistics, after its backward pass.
  void observe(const splat::RenderStatistics& statistics);
  /// Makes room for `count` more Gaussians at the end, of which nothing is known.
  void extend(std::int64_t count);
  /// Keeps those where `which` [size()] (bool) is set.
  void keep(const torch::Tensor& which);
  /// Puts what is known of Gaussian order[i] [size()] (int64) at place i.
  void reorder(const torch::Tensor& order);
  /// Mean pull at the projected centre over the views that saw it, [N]; 0 where none did.
  torch::Tensor mean_gradient() const { return gradient_sum_ / views_.clamp_min(1.0); }
  /// Number of views that saw it [N], and its largest blend weight there [N].
  const torch::Tensor& views() const { return views_; }
  const torch::Tensor& max_weight() const { return max_weight_; }
  /// The largest blend weight that a view gave it [N], 2 % less with every view that saw it since
  /// that view's round; one to begin with. What has little is missed least (Niemeyer et al.,
  /// "RadSplat", 2024, who take the largest over all views).
  torch::Tensor importance() const;

  void save(torch::serialize::OutputArchive& archive) const;
  /// In the computer's own memory.
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor gradient_sum_, views_, max_weight_;  // [N] float32
  torch::Tensor importance_;                         // when the round began
};

struct DensifyResult {
  std::int64_t cloned = 0;
  std::int64_t split = 0;
  std::int64_t pruned = 0;
};

/// One round of growth and pruning. Where the mean gradient is above the threshold, small Gaussians
/// are doubled (with the opacity that keeps the two together as opaque as the one was; Bulò et al.,
/// "Revising densification in Gaussian splatting", 2024) and large ones replaced by two of 1/1.6 of
/// the size drawn from them (Kerbl et al., 2023); the strongest first, until the map has `limit`
/// Gaussians. Those that are too faint, too large or that no view needs are removed. `statistics`
/// are of the new Gaussians afterwards. The same for the same `seed`.
DensifyResult densify(splat::GaussianStore& store, DensityStatistics& statistics,
                      const DensifyOptions& options, double extent, std::int64_t limit,
                      std::uint64_t seed);

/// Which Gaussians are of no use [N] bool; part of `densify`.
torch::Tensor useless(const splat::Gaussians& gaussians, const DensityStatistics& statistics,
                      const DensifyOptions& options, double extent);

}  // namespace apvi::mapping
