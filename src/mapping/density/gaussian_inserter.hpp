// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

#include "apvi/mapping/options.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Inserts Gaussians into a growing map within its limit, and tracks the scene's extent. Each
/// insertion gets at most a share of the limit, which leaves room for later keyframes. In a full
/// map the least important Gaussians of older keyframes are pruned.
///
/// Throws c10::Error when the device runs out of memory; may then be called again.
class GaussianInserter {
 public:
  explicit GaussianInserter(const MapperOptions& options);

  /// Inserts Gaussians at the seeds of a keyframe, at least one; fewer and larger ones without
  /// enough room.
  void insert(Seeds seeds, std::size_t view, const KeyframeStore& keyframes,
              MapOptimizer& optimizer);
  /// Inserts `DensifyOptions::random_per_round` Gaussians at random pixels of a keyframe.
  void insert_random(std::size_t view, const KeyframeStore& keyframes,
                     MapOptimizer& optimizer) const;

  void change_scale(const gaussians::ScaleChange& change) { extent_ *= change.scale; }
  /// Whether Gaussians have been inserted at seeds.
  bool started() const { return extent_ > 0.0; }
  /// Scene extent that scales sizes and rates [m]; 0 before the first seeds.
  double extent() const { return extent_; }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  std::int64_t make_room(std::int64_t wanted, const KeyframeStore& keyframes,
                         MapOptimizer& optimizer) const;

  OnlineOptions online_;
  int sh_degree_;
  int random_per_round_;
  std::uint64_t seed_;
  double extent_ = 0.0;
};

}  // namespace apvi::mapping
