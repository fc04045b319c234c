// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/view.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Odometry drifts less in so much time than pictures can tell.
inline constexpr std::int64_t kLongAgo_ns = 10'000'000'000;

/// Places as the map had them soon after they were first seen. Never learnt from again, so that it
/// holds still: what is learnt follows the newest keyframes, and keyframes that were put where it
/// has them would follow it in turn, a little further each time.
class FirstSight {
 public:
  /// Of so many Gaussians at most; then the oldest go.
  explicit FirstSight(std::int64_t most) : most_(most) {}

  /// Takes in those of `gaussians`, made of one keyframe, that stand where its camera saw nothing
  /// that had been known for long. Keyframes in order of their stamps.
  void remember(const splat::Gaussians& gaussians, const splat::View& camera,
                std::int64_t stamp_ns);

  /// Moves what was first seen at a keyframe. A colour stays as it was.
  void move(std::int64_t stamp_ns, const torch::Tensor& motion);

  /// Without change of colour by direction; empty before anything is remembered.
  const splat::Gaussians& gaussians() const { return kept_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive, const torch::Device& device);

 private:
  splat::Gaussians before(std::int64_t stamp_ns) const;

  std::int64_t most_ = 0;
  splat::Gaussians kept_;
  torch::Tensor stamps_ = torch::empty({0}, torch::kInt64);  ///< [n] of `kept_`, rising
};

}  // namespace apvi::mapping
