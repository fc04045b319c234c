// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "gaussians/metrics/lpips.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Image quality metrics of one image, or their means; empty where not computable.
struct ImageMetrics {
  std::optional<double> psnr_db;
  std::optional<double> ssim;
  std::optional<double> ms_ssim;
  std::optional<double> lpips;
  /// PSNR of the median training image: a baseline without any scene content.
  std::optional<double> psnr_median_image_db;
};

/// Compares keyframes with renderings from their given poses, one by one, where they show the
/// scene; LPIPS only with `perceptual`. MS-SSIM and LPIPS, which do not take pixels alone, see the
/// image itself where it shows something else.
std::vector<ImageMetrics> evaluate_images(const Map& map, const KeyframeStore& keyframes,
                                          const std::vector<std::size_t>& which,
                                          const std::optional<gaussians::Lpips>& perceptual);

/// Means of the metrics that all images have.
ImageMetrics mean_of(const std::vector<ImageMetrics>& images);

/// Mean PSNR [dB]; empty without keyframes.
std::optional<double> mean_psnr(const Map& map, const KeyframeStore& keyframes,
                                const std::vector<std::size_t>& which);

}  // namespace apvi::mapping
