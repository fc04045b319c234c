// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

/// Per-patch arithmetic of a plane sweep, independent of LibTorch.
namespace apvi::depth::cpu {

/// A patch has 6 x 6 pixels without the corners, so its center is, like that of a block, the corner
/// of four pixels.
inline constexpr int kSamples = 32;
inline constexpr float kPatchReach = 2.5F;  ///< [px] from the center to the outermost samples

/// A pyramid level in 1/256 gray levels; each word contains a pixel (low half) and the one below it
/// (high half).
struct Level {
  const std::uint32_t* pairs;
  int width;
  int height;
};

/// Sample positions of a patch: center plus matrix times the offset in the reference, in pixels of
/// the level, with integer pixel centers.
struct PatchTransform {
  float x, y;
  float xx, xy, yx, yy;
};

/// Whether all samples are inside the image.
inline bool inside(const Level& level, const PatchTransform& p) {
  const float reach_x = kPatchReach * ((p.xx < 0 ? -p.xx : p.xx) + (p.xy < 0 ? -p.xy : p.xy));
  const float reach_y = kPatchReach * ((p.yx < 0 ? -p.yx : p.yx) + (p.yy < 0 ? -p.yy : p.yy));
  return p.x - reach_x >= 0.0F && p.y - reach_y >= 0.0F &&
         p.x + reach_x < static_cast<float>(level.width - 1) &&
         p.y + reach_y < static_cast<float>(level.height - 1);
}

/// A reference patch, prepared for comparison.
struct Patch {
  alignas(64) std::array<float, kSamples> values;   ///< minus the mean
  alignas(64) std::array<float, kSamples> weights;  ///< with mean 1
  float mean;
  float inverse_norm;  ///< of the values, including noise
  float noise_sum;     ///< noise variance summed over the samples
};

/// `place` must be `inside`. `noise`, and `sigma`, the difference from the center at which weights
/// fall to 1/e, are in 1/256 gray levels.
Patch sample_patch(const Level& level, const PatchTransform& place, float noise, float sigma);

/// 1 - weighted correlation of a patch with the image at `place`, at most 1; near 1 without
/// contrast.
float correlation_cost(const Patch& patch, const Level& level, const PatchTransform& place);

/// Weighted mean absolute difference between the image and gain * patch + offset, in 1/256 gray
/// levels.
float difference_cost(const Patch& patch, const Level& level, const PatchTransform& place,
                      float gain, float offset);

}  // namespace apvi::depth::cpu
