// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

/// Image and depth quality metrics. Images [H,W,3], of a floating type, in [0, 1]. All functions
/// throw c10::Error for mismatched shapes. `valid` [H,W] bool: the pixels that count; undefined:
/// all.
namespace apvi::gaussians {

/// Peak signal-to-noise ratio over pixels and channels [dB]; infinite for equal images.
double psnr(const torch::Tensor& image, const torch::Tensor& truth,
            const torch::Tensor& valid = {});

/// Mean structural similarity (Wang et al., 2004), 11 px Gaussian window, sigma 1.5, valid windows
/// only; averaged over channels and valid centers of windows. Same as scikit-image with
/// gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1. Nothing for images
/// smaller than the window.
std::optional<double> ssim(const torch::Tensor& image, const torch::Tensor& truth,
                           const torch::Tensor& valid = {});

/// Multi-scale SSIM, five scales (Wang et al., "Multiscale structural similarity", 2003). Nothing
/// for images below 176 px a side, where the coarsest scale is smaller than the window.
std::optional<double> ms_ssim(const torch::Tensor& image, const torch::Tensor& truth);

/// Per-pixel, per-channel median of images of one size. Its score is the baseline of a metric: in
/// turbid water all images look alike, so predicting the median already scores well.
torch::Tensor median_image(const std::vector<torch::Tensor>& images);

struct DepthErrors {
  double rmse_m;
  double abs_rel;       ///< mean of |estimate - truth| / truth
  double coverage;      ///< fraction of valid ground truth pixels with an estimate
  std::int64_t pixels;  ///< number of compared pixels
};
/// Errors of a depth map [H,W] [m] where both maps are valid (positive and finite); nothing if no
/// pixel is.
std::optional<DepthErrors> depth_errors(const torch::Tensor& depth, const torch::Tensor& truth);

/// Root mean square error [m] of a perfect depth map [H,W] shifted by half a pixel: the baseline of
/// depth errors. It is large where thin structures stand in front of a distant background, and
/// smaller errors are not meaningful. Nothing when no two neighboring pixels are valid.
std::optional<double> half_pixel_depth_rmse(const torch::Tensor& truth);

}  // namespace apvi::gaussians
