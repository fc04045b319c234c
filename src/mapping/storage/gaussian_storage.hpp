// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <map>
#include <vector>

#include "mapping/alignment/keyframe_poses.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// The Gaussians of a map that are not on the device, in host memory, by the keyframe that they are
/// anchored to. Corrections of keyframes are noted here and applied when Gaussians are read, so
/// that they cost the same however many there are.
class GaussianStorage {
 public:
  void add(DetachedGaussians detached);
  /// Moves the Gaussians of each keyframe.
  void move(const KeyframeMotions& motions);
  /// Counts changes by `add`, `take` and `move`.
  std::int64_t version() const { return version_; }
  /// Removes the Gaussians of these keyframes and returns them, moved; those of the same appearance
  /// together.
  std::vector<DetachedGaussians> take(const std::vector<std::int64_t>& anchors);
  /// The same without removing them, or only every `stride`-th Gaussian of each keyframe.
  std::vector<DetachedGaussians> read(const std::vector<std::int64_t>& anchors,
                                      int stride = 1) const;

  bool holds(std::int64_t anchor) const { return blocks_.contains(anchor); }
  std::vector<std::int64_t> anchors() const;
  std::int64_t size() const { return size_; }
  /// Of the Gaussians of one keyframe; 0 when it has none here.
  std::int64_t size(std::int64_t anchor) const;
  std::int64_t bytes() const { return bytes_; }

 private:
  /// Gaussians of a keyframe that were stored at the same time.
  struct Block {
    DetachedGaussians gaussians;
    torch::Tensor motion;  ///< [4,4] float64 since it was stored; undefined: none
  };
  static DetachedGaussians joined(const std::vector<const Block*>& blocks, int stride);

  std::map<std::int64_t, std::vector<Block>> blocks_;
  std::int64_t size_ = 0;
  std::int64_t bytes_ = 0;
  std::int64_t version_ = 0;
};

/// Saves Gaussians bitwise, but not their appearance.
void save(torch::serialize::OutputArchive& archive, const DetachedGaussians& detached);
/// Loads what `save` wrote. Throws c10::Error when tensors do not match.
DetachedGaussians load_detached(torch::serialize::InputArchive& archive);

}  // namespace apvi::mapping
