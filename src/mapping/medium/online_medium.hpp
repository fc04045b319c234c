// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

#include "apvi/mapping/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/medium/medium_schedule.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Estimates the medium of a growing map, by the method of
/// `TrainerOptions::medium_estimation`.
class OnlineMedium {
 public:
  explicit OnlineMedium(const MapperOptions& options);

  /// Call for each accepted keyframe before it is in the store; `accepted` includes it.
  void observe(std::int64_t stamp_ns, const KeyframeStore& keyframes, std::size_t accepted);
  /// Whether an estimation is due at `accepted` keyframes, which then counts as done. While
  /// `busy`, only the first one is.
  bool take_due(std::size_t accepted, bool busy, const MapOptimizer& optimizer);
  /// Whether the medium of a map is estimated at all.
  bool is_estimated(const MapOptimizer& optimizer) const;
  /// Estimates the medium and applies it. Returns whether the map's colors changed abruptly. Throws
  /// c10::Error when the device runs out of memory; may then be called again.
  bool estimate(std::int64_t iteration, double extent, KeyframeStore& keyframes,
                MapOptimizer& optimizer) const;

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  bool fit(std::int64_t iteration, double extent, KeyframeStore& keyframes,
           MapOptimizer& optimizer) const;

  MapperOptions options_;
  MediumSchedule schedule_;
};

}  // namespace apvi::mapping
