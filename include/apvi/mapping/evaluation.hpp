// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/splat/lpips.hpp"

namespace apvi::mapping {

/// How alike two images are, or means of that over images; what cannot be computed is absent.
struct ImageMetrics {
  std::optional<double> psnr_db;
  std::optional<double> ssim;
  std::optional<double> ms_ssim;
  std::optional<double> lpips;
  /// PSNR of the training images' median, which sees nothing but the water: what is not above it
  /// was not mapped.
  std::optional<double> psnr_median_image_db;
};

/// Compares keyframes with what the map shows from their given poses, one by one; LPIPS by
/// `perceptual`, if there is one.
std::vector<ImageMetrics> evaluate_images(const Map& map, const KeyframeStore& keyframes,
                                          const std::vector<std::size_t>& which,
                                          const std::optional<splat::Lpips>& perceptual);

/// Means of what no image lacks.
ImageMetrics mean_of(const std::vector<ImageMetrics>& images);

/// The mean peak signal-to-noise ratio alone [dB]; nothing without keyframes.
std::optional<double> mean_psnr(const Map& map, const KeyframeStore& keyframes,
                                const std::vector<std::size_t>& which);

}  // namespace apvi::mapping
