// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/evaluation.hpp"

#include <torch/torch.h>

#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;

double psnr(const Tensor& image, const Tensor& target) {
  const double mse = (image.clamp(0.0, 1.0) - target).square().mean().item<double>();
  return -10.0 * std::log10(std::max(mse, 1e-12));
}

// In bytes, to hold all images at once.
Tensor median_image(const KeyframeStore& keyframes) {
  std::vector<Tensor> images;
  for (const std::size_t i : keyframes.training()) images.push_back(keyframes[i].image);
  return std::get<0>(torch::stack(images).median(0)).to(torch::kFloat32) / 255.0;
}

}  // namespace

std::optional<double> mean_psnr(const Map& map, const KeyframeStore& keyframes,
                                const std::vector<std::size_t>& which) {
  if (which.empty()) return std::nullopt;
  double sum = 0.0;
  for (const std::size_t i : which) {
    const Tensor image = take_picture(map, keyframes.view(i, 1)).as_seen;
    sum += psnr(image, keyframes.image(i, 1, image.device()));
  }
  return sum / static_cast<double>(which.size());
}

ImageMetrics evaluate_images(const Map& map, const KeyframeStore& keyframes,
                             const std::vector<std::size_t>& which) {
  ImageMetrics metrics;
  if (which.empty()) return metrics;
  metrics.psnr_db = mean_psnr(map, keyframes, which);
  const Tensor median = median_image(keyframes);
  double sum = 0.0;
  for (const std::size_t i : which) sum += psnr(median, keyframes.image(i, 1, torch::kCPU));
  metrics.psnr_median_image_db = sum / static_cast<double>(which.size());
  return metrics;
}

}  // namespace apvi::mapping
