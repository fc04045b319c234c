// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

/// The arithmetic of a depth sweep, one patch at a time, free of LibTorch.
namespace apvi::mapping::cpu {

/// A patch is six pixels wide and high, without its corners, so that its middle is where a block's
/// is: where four pixels meet.
inline constexpr int kSamples = 32;
inline constexpr float kPatchReach = 2.5F;  ///< [px] of its outermost samples from the middle

/// A picture in one reduction, 1/256 grey levels; each word holds a pixel (low half) and the one
/// below it.
struct Level {
  const std::uint32_t* pairs;
  int width;
  int height;
};

/// Where the samples of a patch are taken: at the middle plus a matrix times their place in the
/// reference, in pixels of the level whose centres are whole numbers.
struct PatchPlace {
  float x, y;
  float xx, xy, yx, yy;
};

/// Whether all samples lie in the picture.
inline bool inside(const Level& level, const PatchPlace& p) {
  const float reach_x = kPatchReach * ((p.xx < 0 ? -p.xx : p.xx) + (p.xy < 0 ? -p.xy : p.xy));
  const float reach_y = kPatchReach * ((p.yx < 0 ? -p.yx : p.yx) + (p.yy < 0 ? -p.yy : p.yy));
  return p.x - reach_x >= 0.0F && p.y - reach_y >= 0.0F &&
         p.x + reach_x < static_cast<float>(level.width - 1) &&
         p.y + reach_y < static_cast<float>(level.height - 1);
}

/// A patch of the reference, ready to be compared.
struct Patch {
  alignas(64) std::array<float, kSamples> values;   ///< less their mean
  alignas(64) std::array<float, kSamples> weights;  ///< of mean 1
  float mean;
  float inverse_norm;  ///< of the values, with the noise added
  float noise_sum;     ///< squared noise of all samples
};

/// `place` must be `inside`. `noise` and `sigma`, by which samples differ from the middle that
/// weigh 1/e, in 1/256 grey levels.
Patch take_patch(const Level& level, const PatchPlace& place, float noise, float sigma);

/// One minus the weighted correlation of a patch with the picture at `place`, or 1 where that is
/// negative; near 1 for what has no contrast.
float correlation_cost(const Patch& patch, const Level& level, const PatchPlace& place);

/// Weighted mean of the absolute difference of the picture from gain * patch + offset, in 1/256
/// grey levels.
float difference_cost(const Patch& patch, const Level& level, const PatchPlace& place, float gain,
                      float offset);

}  // namespace apvi::mapping::cpu
