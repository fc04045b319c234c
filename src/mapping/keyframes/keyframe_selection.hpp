// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string_view>
#include <vector>

#include "apvi/mapping/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// How an input keyframe was handled.
enum class KeyframeDecision {
  accepted,
  held_out,   ///< kept for evaluation
  no_image,   ///< pose and point updates only
  duplicate,  ///< its stamp is already in the map
  bad_pose,   ///< not a rigid transform, or not finite
  bad_image,  ///< not [H,W,3] uint8 of the camera's size
  black,
  low_visibility,  ///< no visible structure, in this image or shortly before it
};
std::string_view to_string(KeyframeDecision decision);

/// Selects the images of a map: rejects invalid ones and those around low visibility, thins
/// held-out images and limits the memory of training images. Dropped keyframes keep their poses.
class KeyframeSelection {
 public:
  explicit KeyframeSelection(const OnlineOptions& options);

  /// Drops the images shortly before a loss of visibility at `stamp_ns`, and rejects those shortly
  /// after it. Returns the training keyframes that were dropped.
  std::vector<std::size_t> lose_visibility(std::int64_t stamp_ns, KeyframeStore& keyframes);
  /// Decides about a keyframe that is not in the store yet, and counts the decision.
  KeyframeDecision decide(const Keyframe& keyframe, bool low_visibility,
                          const KeyframeStore& keyframes);
  /// Call after each held-out image.
  void thin_held_out(KeyframeStore& keyframes);
  /// Returns the training keyframes that were dropped.
  std::vector<std::size_t> limit_image_memory(KeyframeStore& keyframes) const;

  const std::map<KeyframeDecision, std::size_t>& counts() const { return counts_; }
  /// Number of accepted training keyframes, without those dropped for low visibility.
  std::size_t accepted() const;

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  KeyframeDecision check(const Keyframe& keyframe, bool low_visibility,
                         const KeyframeStore& keyframes) const;
  std::size_t max_held_out(const Keyframe& keyframe) const;

  std::size_t recent_keyframes_;
  std::size_t max_heldout_views_;
  double max_image_bytes_;
  double max_host_image_bytes_;
  std::map<KeyframeDecision, std::size_t> counts_;
  std::int64_t heldout_stride_ = 1;
  std::int64_t low_visibility_until_ns_ = 0;  ///< images before this stamp are rejected
};

}  // namespace apvi::mapping
