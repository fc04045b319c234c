// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/splat/lpips.hpp"

namespace apvi::mapping {

/// Means over images; what cannot be computed is absent.
struct ImageMetrics {
  std::optional<double> psnr_db;
  std::optional<double> ssim;
  std::optional<double> ms_ssim;
  std::optional<double> lpips;
  /// PSNR of the training images' median, which sees nothing but the water: what is not above it
  /// was not mapped.
  std::optional<double> psnr_median_image_db;
};

/// Compares keyframes with what the map shows from their given poses; LPIPS by `perceptual`, if
/// there is one.
ImageMetrics evaluate_images(const Map& map, const KeyframeStore& keyframes,
                             const std::vector<std::size_t>& which,
                             const std::optional<splat::Lpips>& perceptual);

/// The mean peak signal-to-noise ratio alone [dB]; nothing without keyframes.
std::optional<double> mean_psnr(const Map& map, const KeyframeStore& keyframes,
                                const std::vector<std::size_t>& which);

}  // namespace apvi::mapping
