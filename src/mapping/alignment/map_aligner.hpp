// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <optional>

#include "mapping/alignment/frozen_reference_map.hpp"
#include "mapping/alignment/image_alignment.hpp"
#include "mapping/alignment/keyframe_poses.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {

/// Aligns new keyframes to the frozen reference map, and extends that map as keyframes get older.
class MapAligner {
 public:
  /// `max_gaussians` of the reference map.
  explicit MapAligner(std::int64_t max_gaussians) : reference_map_(max_gaussians) {}

  /// Aligned pose [4,4] float64 of keyframe `view`, of which `sigmas` are the standard deviations;
  /// nothing when the reference map does not show the same area. Throws c10::Error when the device
  /// runs out of memory; may then be called again.
  std::optional<torch::Tensor> align(const KeyframeStore& keyframes, std::size_t view,
                                     const PoseSigmas& sigmas, const MapOptimizer& optimizer);
  /// Moves the Gaussians of each keyframe.
  void move(const KeyframeMotions& motions, const KeyframeStore& keyframes);

  void change_scale(const gaussians::ScaleChange& change) { reference_map_.change_scale(change); }

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  void extend(const KeyframeStore& keyframes, std::int64_t stamp_ns, const MapOptimizer& optimizer);

  FrozenReferenceMap reference_map_;
  std::size_t end_ = 0;  ///< keyframes before this index are in it
};

}  // namespace apvi::mapping
