// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

/// How good a rendered image is. Images [H,W,3], of a floating type, in [0, 1]. All functions throw
/// c10::Error when the shapes do not fit.
namespace apvi::splat {

/// Peak signal-to-noise ratio over all pixels and channels [dB]; infinite for equal images.
double psnr(const torch::Tensor& image, const torch::Tensor& truth);

/// Mean structural similarity (Wang et al., 2004), with a Gaussian window of 11 pixels, sigma 1.5,
/// where it fits into the image; the mean of the channels. What scikit-image calls
/// gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1. Nothing for images
/// smaller than the window.
std::optional<double> ssim(const torch::Tensor& image, const torch::Tensor& truth);

/// The same over five scales (Wang et al., "Multiscale structural similarity", 2003). Nothing for
/// images of less than 176 pixels a side, of which the smallest scale would be less than a window.
std::optional<double> ms_ssim(const torch::Tensor& image, const torch::Tensor& truth);

/// Median of every pixel and channel over images of one size. What a metric gives for it is the
/// control: turbid water makes all pictures alike, and whoever predicts that picture scores well.
torch::Tensor median_image(const std::vector<torch::Tensor>& images);

struct DepthErrors {
  double rmse_m;
  double abs_rel;       ///< mean of |estimate - truth| / truth
  double coverage;      ///< part of the true pixels that have an estimate
  std::int64_t pixels;  ///< compared
};
/// Of a depth map [H,W] [m] where both have one (positive and finite); nothing if that is nowhere.
std::optional<DepthErrors> depth_errors(const torch::Tensor& depth, const torch::Tensor& truth);

/// What a perfect map would be off by, root mean square [m], that stood half a pixel beside a true
/// depth map [H,W]. The control of depth errors: where thin things stand before far ones it is
/// large, and no error of a map says much that is smaller. Nothing where no two pixels have depth.
std::optional<double> half_pixel_depth_rmse(const torch::Tensor& truth);

}  // namespace apvi::splat
