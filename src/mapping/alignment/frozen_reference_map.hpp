// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/model/similarity.hpp"
#include "gaussians/render/view.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Gaussians younger than this are not used as a reference; odometry drift is negligible until
/// then.
inline constexpr std::int64_t kReferenceAge_ns = 10'000'000'000;

/// Copy of the map's Gaussians from shortly after each area was first observed, used to align later
/// keyframes. It is never optimized: the optimized map follows the newest keyframes, and aligning
/// keyframes to it would accumulate drift.
class FrozenReferenceMap {
 public:
  /// When full, the oldest Gaussians are dropped.
  explicit FrozenReferenceMap(std::int64_t max_gaussians) : max_gaussians_(max_gaussians) {}

  /// Inserts those of one keyframe's `gaussians` that project to pixels not covered by older parts
  /// of the reference map. Call in order of stamps.
  void insert(const gaussians::Gaussians& gaussians, const gaussians::View& camera,
              std::int64_t stamp_ns);

  /// Moves the Gaussians inserted at a stamp; colors are not rotated.
  void move(std::int64_t stamp_ns, const torch::Tensor& motion);

  void change_scale(const gaussians::ScaleChange& change);

  /// Without view-dependent color (SH degree 0); empty before the first insertion.
  const gaussians::Gaussians& gaussians() const { return gaussians_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive, const torch::Device& device);

 private:
  gaussians::Gaussians older_than(std::int64_t stamp_ns) const;

  std::int64_t max_gaussians_ = 0;
  gaussians::Gaussians gaussians_;
  torch::Tensor stamps_ = torch::empty({0}, torch::kInt64);  ///< [n] of `gaussians_`, ascending
};

}  // namespace apvi::mapping
