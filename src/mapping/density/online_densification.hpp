// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

#include "apvi/mapping/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Schedules the rounds of cloning, splitting and pruning during incremental mapping. What they may
/// add grows with each keyframe by a fraction of the room left.
class OnlineDensification {
 public:
  explicit OnlineDensification(const MapperOptions& options);

  /// Call for each new keyframe, before its Gaussians are inserted.
  void add_budget(std::int64_t room);
  /// Whether a round is due after `iteration` steps on `views` keyframes.
  bool is_due(std::int64_t iteration, std::size_t views) const;
  /// Runs a round; frees memory as `retry_on_oom`.
  void run(std::int64_t iteration, double extent, MapOptimizer& optimizer,
           KeyframeStore& keyframes);

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  std::int64_t interval_steps(std::int64_t iteration, std::size_t views) const;

  DensifyOptions options_;
  double budget_fraction_;
  std::int64_t max_interval_;
  std::uint64_t seed_;
  double budget_ = 0.0;    ///< Gaussians that may still be added
  std::int64_t last_ = 0;  ///< iteration of the last round
};

}  // namespace apvi::mapping
