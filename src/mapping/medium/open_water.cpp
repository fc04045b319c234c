// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/open_water.hpp"

#include <torch/torch.h>

#include "mapping/training/step_backend.hpp"
#include "mapping/training/step_constants.hpp"

namespace apvi::mapping {

using torch::Tensor;

namespace {

Tensor mean_around(const Tensor& planes) {
  return torch::avg_pool2d(planes, step::kOpenWaterWindow, 1, step::kOpenWaterWindow / 2,
                           /*ceil_mode=*/false,
                           /*count_include_pad=*/false);
}

}  // namespace

Horizon horizon(const gaussians::View& camera) {
  const gaussians::Intrinsics& k = camera.intrinsics;
  const auto T = camera.T_camera_world.accessor<double, 2>();
  const double across = T[0][2] / k.fx;
  const double down = T[1][2] / k.fy;
  return {static_cast<float>(across), static_cast<float>(down),
          static_cast<float>(T[2][2] - across * k.cx - down * k.cy)};
}

Tensor above_horizon(const Horizon& horizon, std::int64_t height, std::int64_t width,
                     const torch::Device& device) {
  const auto options = torch::dtype(torch::kFloat32).device(device);
  const auto& [across, down, offset] = horizon;
  const Tensor x = torch::arange(width, options) + 0.5;
  const Tensor y = (torch::arange(height, options) + 0.5).unsqueeze(1);
  return across * x + down * y + offset > 0.0;
}

std::pair<Tensor, Tensor> local_uniformity(const Tensor& image) {
  const torch::NoGradGuard no_grad;
  const Tensor planes = image.permute({2, 0, 1});
  const Tensor mean = mean_around(planes);
  const Tensor texture = mean_around(planes.square()).sub_(mean.square()).amax(0);
  return {mean, texture < step::kOpenWaterMaxStddev * step::kOpenWaterMaxStddev};
}

Tensor open_water(const Tensor& image, const Tensor& water) {
  return classify_water(image, water) == 1;
}

Tensor classify_water(const Tensor& image, const Tensor& water) {
  return step_backend(image.device()).classify_water(image, water);
}

Tensor opacity_loss_gradient(const Tensor& image, const Tensor& water, const Tensor& alpha,
                             const OpacityWeights& weights) {
  return step_backend(image.device()).opacity_loss_gradient(image, water, alpha, weights);
}

}  // namespace apvi::mapping
