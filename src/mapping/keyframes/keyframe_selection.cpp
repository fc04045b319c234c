// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/keyframe_selection.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <limits>

#include "gaussians/model/archive.hpp"
#include "mapping/keyframes/image_visibility.hpp"
#include "mapping/storage/stored_memory.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Silt clouds last a second or two. Images at their edges pass the visibility check but would still
// leave semi-transparent Gaussians in the map.
constexpr std::int64_t kLowVisibilityMargin_ns = 700'000'000;
constexpr std::size_t kMinTrainingKeyframes = 2;  // that are always kept
constexpr double kMaxHeldOutShare = 0.25;         // of the memory for images

/// The keyframe among `views` whose neighbors in time are closest to each other; neither the first
/// nor one of the `recent` last ones, of which there is at least one.
std::size_t most_redundant(const std::vector<std::size_t>& views, const KeyframeStore& keyframes,
                           std::size_t recent) {
  std::size_t redundant = views[1];
  double min_gap = std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k + recent < views.size(); ++k) {
    const double gap = camera_distance(keyframes[views[k - 1]].T_camera_world,
                                       keyframes[views[k + 1]].T_camera_world);
    if (gap >= min_gap) continue;
    min_gap = gap;
    redundant = views[k];
  }
  return redundant;
}

std::vector<std::size_t> training_views(const KeyframeStore& keyframes, bool on_host) {
  std::vector<std::size_t> views;
  for (const std::size_t view : keyframes.training()) {
    const bool is_on_host = keyframes.on_host().count(view) != 0;
    if (keyframes[view].image.defined() && is_on_host == on_host) views.push_back(view);
  }
  return views;
}

bool matches_camera(const Tensor& image, const gaussians::Intrinsics& camera) {
  return image.scalar_type() == torch::kUInt8 && image.numel() > 0 &&
         image.sizes() == at::IntArrayRef({camera.height, camera.width, 3});
}

}  // namespace

std::string_view to_string(KeyframeDecision decision) {
  switch (decision) {
    case KeyframeDecision::accepted:
      return "accepted";
    case KeyframeDecision::held_out:
      return "held_out";
    case KeyframeDecision::no_image:
      return "no_image";
    case KeyframeDecision::duplicate:
      return "duplicate";
    case KeyframeDecision::bad_pose:
      return "bad_pose";
    case KeyframeDecision::bad_image:
      return "bad_image";
    case KeyframeDecision::black:
      return "black";
    case KeyframeDecision::low_visibility:
      return "low_visibility";
  }
  return "unknown";
}

KeyframeSelection::KeyframeSelection(const OnlineOptions& options)
    : recent_keyframes_(static_cast<std::size_t>(std::max(2, options.recent_keyframes))),
      max_heldout_views_(static_cast<std::size_t>(std::max(1, options.max_heldout_views))),
      max_image_bytes_(options.image_memory_mib * 1024.0 * 1024.0),
      max_host_image_bytes_(stored_memory(options).images) {}

// Visibility degrades gradually, so keyframes just before the loss are dropped as well.
std::vector<std::size_t> KeyframeSelection::lose_visibility(std::int64_t stamp_ns,
                                                            KeyframeStore& keyframes) {
  const bool is_lost_already = stamp_ns < low_visibility_until_ns_;
  low_visibility_until_ns_ = stamp_ns + kLowVisibilityMargin_ns;
  std::vector<std::size_t> dropped;
  if (is_lost_already) return dropped;
  const auto& by_stamp = keyframes.by_stamp();
  const auto first = by_stamp.lower_bound(stamp_ns - kLowVisibilityMargin_ns);
  for (auto it = first; it != by_stamp.end(); ++it) {
    const std::size_t view = it->second;
    if (!keyframes.has_image(view)) continue;
    const bool held_out = keyframes[view].held_out;
    if (!held_out && keyframes.training().size() <= kMinTrainingKeyframes) continue;
    --counts_[held_out ? KeyframeDecision::held_out : KeyframeDecision::accepted];
    ++counts_[KeyframeDecision::low_visibility];
    keyframes.drop_image(view);
    if (!held_out) dropped.push_back(view);
  }
  return dropped;
}

KeyframeDecision KeyframeSelection::decide(const Keyframe& keyframe, bool low_visibility,
                                           const KeyframeStore& keyframes) {
  const KeyframeDecision decision = check(keyframe, low_visibility, keyframes);
  ++counts_[decision];
  return decision;
}

KeyframeDecision KeyframeSelection::check(const Keyframe& keyframe, bool low_visibility,
                                          const KeyframeStore& keyframes) const {
  const Tensor& image = keyframe.image;
  if (!image.defined()) return KeyframeDecision::no_image;
  if (!is_rigid(keyframe.T_camera_world)) return KeyframeDecision::bad_pose;
  if (!matches_camera(image, keyframe.intrinsics)) return KeyframeDecision::bad_image;
  if (keyframes.by_stamp().count(keyframe.stamp_ns) > 0) return KeyframeDecision::duplicate;
  const Tensor& scene = keyframe.scene.defined() ? keyframe.scene : keyframes.mask();
  if (is_black(image, scene)) return KeyframeDecision::black;
  if (low_visibility || keyframe.stamp_ns < low_visibility_until_ns_) {
    return KeyframeDecision::low_visibility;
  }
  return keyframe.held_out ? KeyframeDecision::held_out : KeyframeDecision::accepted;
}

// When there are too many held-out images, doubles the stride and drops every second one. The
// stride counts the recording's images, so that the selection does not depend on lost frames and a
// simulator can predict which images need ground truth.
void KeyframeSelection::thin_held_out(KeyframeStore& keyframes) {
  const auto is_dropped = [&](std::size_t i) { return keyframes[i].number % heldout_stride_ != 0; };
  const std::size_t newest = keyframes.size() - 1;
  if (is_dropped(newest)) return keyframes.drop_image(newest);
  const std::size_t limit = max_held_out(keyframes[newest]);
  while (keyframes.held_out().size() > limit) {
    heldout_stride_ *= 2;
    const std::vector<std::size_t> all = keyframes.held_out();
    for (const std::size_t i : all) {
      if (is_dropped(i)) keyframes.drop_image(i);
    }
    if (heldout_stride_ > keyframes[newest].number) return;  // only number zero can remain
  }
}

// Large held-out images must not take the memory of those that the map is made of.
std::size_t KeyframeSelection::max_held_out(const Keyframe& keyframe) const {
  const double images = max_image_bytes_ / static_cast<double>(keyframe.image.nbytes());
  const auto share = static_cast<std::size_t>(kMaxHeldOutShare * images);
  return std::clamp<std::size_t>(share, 1, max_heldout_views_);
}

std::vector<std::size_t> KeyframeSelection::limit_image_memory(KeyframeStore& keyframes) const {
  std::vector<std::size_t> dropped;
  const auto drop_beyond = [&](double limit, bool on_host, std::size_t recent) {
    const auto bytes = [&] {
      return static_cast<double>(on_host ? keyframes.host_image_bytes() : keyframes.image_bytes());
    };
    while (bytes() > limit) {
      const std::vector<std::size_t> views = training_views(keyframes, on_host);
      if (views.size() <= recent + 2) return;
      dropped.push_back(most_redundant(views, keyframes, recent));
      keyframes.drop_image(dropped.back());
    }
  };
  drop_beyond(max_image_bytes_, /*on_host=*/false, recent_keyframes_);
  keyframes.write_host_images(max_host_image_bytes_);
  drop_beyond(max_host_image_bytes_, /*on_host=*/true, 1);
  return dropped;
}

std::size_t KeyframeSelection::accepted() const {
  const auto found = counts_.find(KeyframeDecision::accepted);
  return found == counts_.end() ? 0 : found->second;
}

void KeyframeSelection::save(torch::serialize::OutputArchive& archive) const {
  archive.write("heldout_stride", c10::IValue(heldout_stride_));
  archive.write("low_visibility_until_ns", c10::IValue(low_visibility_until_ns_));
}

void KeyframeSelection::load(torch::serialize::InputArchive& archive) {
  heldout_stride_ = gaussians::read_int(archive, "heldout_stride");
  low_visibility_until_ns_ = gaussians::read_int(archive, "low_visibility_until_ns");
}

}  // namespace apvi::mapping
