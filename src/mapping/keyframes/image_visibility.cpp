// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/image_visibility.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kBlackLevel = 3.0;  // gray levels of 255: maximum mean and standard deviation

constexpr std::int64_t kCellsPerRow = 80;    // across the image width
constexpr std::int64_t kMinCellSize_px = 4;  // smaller cells cannot separate detail from noise
constexpr std::int64_t kWindowCells = 5;     // cells
constexpr std::int64_t kPixelStride_px = 2;  // demosaicing correlates direct neighbors
constexpr std::int64_t kRowStride = 4;       // rows used for the noise estimate
constexpr double kContrastQuantile = 0.9;
constexpr double kMedianOfNormal = 0.6745;   // sigmas
constexpr double kSaturatedLevel = 254.0;    // gray levels
constexpr double kQuantizationNoise = 0.29;  // gray levels
constexpr double kMaxNoise = 6.0;            // gray levels; more is fine texture

/// Mean of the channels [H,W] float32 of bytes [H,W,3]; faster than a reduction over three values.
Tensor mean_gray(const Tensor& image) {
  const auto channel = [&image](std::int64_t c) { return image.select(2, c).to(torch::kFloat32); };
  return (channel(0) + channel(1) + channel(2)) / 3.0;
}

/// Standard deviation of pixel noise [gray levels], by second differences along a subset of rows.
double estimate_noise(const Tensor& gray) {
  const std::int64_t w = gray.size(1);
  const Tensor rows = gray.slice(0, 0, gray.size(0), kRowStride);
  const Tensor difference = rows.slice(1, 0, w - 2 * kPixelStride_px) -
                            2.0 * rows.slice(1, kPixelStride_px, w - kPixelStride_px) +
                            rows.slice(1, 2 * kPixelStride_px, w);
  const double median = difference.abs().median().item<double>();
  return std::clamp(median / (kMedianOfNormal * std::sqrt(6.0)), kQuantizationNoise, kMaxNoise);
}

}  // namespace

bool is_black(const Tensor& image, const Tensor& scene) {
  Tensor gray = image.to(torch::kFloat32);
  if (scene.defined()) gray = gray.masked_select(scene.to(gray.device()).unsqueeze(2));
  if (gray.numel() == 0) return true;
  return gray.mean().item<double>() < kBlackLevel && gray.std().item<double>() < kBlackLevel;
}

bool has_low_visibility(const Tensor& image, const Tensor& scene) {
  Tensor gray = mean_gray(image);
  if (scene.defined()) {
    const Tensor shown = gray.masked_select(scene);
    if (shown.numel() == 0) return true;
    gray = gray.masked_fill(scene.logical_not(), shown.mean().item<double>());
  }
  if ((gray >= kSaturatedLevel).to(torch::kFloat32).mean().item<double>() > 0.5) return true;
  const std::int64_t side = image.size(1) / kCellsPerRow;
  if (side < kMinCellSize_px || image.size(0) < kWindowCells * side) return false;
  const Tensor cells = torch::avg_pool2d(gray.unsqueeze(0).unsqueeze(0), side);
  const std::int64_t edge = kWindowCells / 2;
  const Tensor inner =
      cells.slice(2, edge, cells.size(2) - edge).slice(3, edge, cells.size(3) - edge);
  const Tensor detail = (inner - torch::avg_pool2d(cells, kWindowCells, 1)).abs().flatten();
  const auto rank =
      static_cast<std::int64_t>(kContrastQuantile * static_cast<double>(detail.numel() - 1));
  const double contrast = std::get<0>(detail.kthvalue(rank + 1)).item<double>();
  return contrast < estimate_noise(gray);
}

}  // namespace apvi::mapping
