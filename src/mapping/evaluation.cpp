// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/evaluation.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "gaussians/metrics/metrics.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kMinLpipsSide_px = 32;
constexpr std::size_t kMaxMedianImages = 200;  // evenly spread, to limit memory

Tensor render_keyframe(const Map& map, const KeyframeStore& keyframes, std::size_t i) {
  const Tensor light =
      render_map(map, keyframes.view(i, 1)).color * camera_response(map, keyframes, i, 1);
  return map.tone_curve.encode(light).clamp(0.0, 1.0);
}

// Undefined without training images.
Tensor training_median(const KeyframeStore& keyframes) {
  const std::vector<std::size_t>& all = keyframes.training();
  if (all.empty()) return {};
  const std::size_t stride = (all.size() + kMaxMedianImages - 1) / kMaxMedianImages;
  std::vector<Tensor> images;
  for (std::size_t k = 0; k < all.size(); k += stride) {
    images.push_back(keyframes.image_values(all[k], 1, torch::kCPU));
  }
  return gaussians::median_image(images);
}

/// Mean of optional values; empty if any of them is.
class Mean {
 public:
  void add(const std::optional<double>& value) {
    complete_ = complete_ && value.has_value();
    sum_ += value.value_or(0.0);
    ++count_;
  }
  std::optional<double> value() const {
    return complete_ && count_ > 0 ? std::optional(sum_ / count_) : std::nullopt;
  }

 private:
  double sum_ = 0.0;
  int count_ = 0;
  bool complete_ = true;
};

}  // namespace

std::optional<double> mean_psnr(const Map& map, const KeyframeStore& keyframes,
                                const std::vector<std::size_t>& which) {
  Mean mean;
  for (const std::size_t i : which) {
    const Tensor image = render_keyframe(map, keyframes, i);
    mean.add(gaussians::psnr(image, keyframes.image_values(i, 1, image.device()),
                             keyframes.scene(i, 1, image.device())));
  }
  return mean.value();
}

std::vector<ImageMetrics> evaluate_images(const Map& map, const KeyframeStore& keyframes,
                                          const std::vector<std::size_t>& which,
                                          const std::optional<gaussians::Lpips>& perceptual) {
  if (which.empty()) return {};
  const Tensor median = training_median(keyframes);
  std::vector<ImageMetrics> images;
  for (const std::size_t i : which) {
    const Tensor image = render_keyframe(map, keyframes, i);
    const Tensor truth = keyframes.image_values(i, 1, image.device());
    const Tensor scene = keyframes.scene(i, 1, image.device());
    const Tensor shown = scene.defined() ? torch::where(scene.unsqueeze(2), image, truth) : image;
    const bool large_enough = std::min(truth.size(0), truth.size(1)) >= kMinLpipsSide_px;
    images.push_back(
        {.psnr_db = gaussians::psnr(image, truth, scene),
         .ssim = gaussians::ssim(image, truth, scene),
         .ms_ssim = gaussians::ms_ssim(shown, truth),
         .lpips =
             perceptual && large_enough ? std::optional((*perceptual)(shown, truth)) : std::nullopt,
         .psnr_median_image_db = median.defined() ? std::optional(gaussians::psnr(
                                                        median.to(truth.device()), truth, scene))
                                                  : std::nullopt});
  }
  return images;
}

ImageMetrics mean_of(const std::vector<ImageMetrics>& images) {
  ImageMetrics means;
  for (std::optional<double> ImageMetrics::*const metric :
       {&ImageMetrics::psnr_db, &ImageMetrics::ssim, &ImageMetrics::ms_ssim, &ImageMetrics::lpips,
        &ImageMetrics::psnr_median_image_db}) {
    Mean mean;
    for (const ImageMetrics& image : images) mean.add(image.*metric);
    means.*metric = mean.value();
  }
  return means;
}

}  // namespace apvi::mapping
