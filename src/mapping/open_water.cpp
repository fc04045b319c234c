// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/open_water.hpp"

#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kSquare = 5;  // [px]
constexpr double kOffset = 0.01;     // of a colour
constexpr double kRelative = 0.06;   // the same over the water's
constexpr double kTexture = 0.03;    // standard deviation over the square, noise and a grain or two

Tensor mean_around(const Tensor& planes) {
  return torch::avg_pool2d(planes, kSquare, 1, kSquare / 2, /*ceil_mode=*/false,
                           /*count_include_pad=*/false);
}

}  // namespace

std::pair<Tensor, Tensor> evenness(const Tensor& picture) {
  const torch::NoGradGuard no_grad;
  const Tensor planes = picture.permute({2, 0, 1});
  const Tensor mean = mean_around(planes);
  const Tensor texture = mean_around(planes.square()).sub_(mean.square()).amax(0);
  return {mean, texture < kTexture * kTexture};
}

Tensor open_water(const Tensor& picture, const Tensor& water) {
  const torch::NoGradGuard no_grad;
  const auto [mean, even] = evenness(picture);
  const Tensor veil = water.permute({2, 0, 1});
  return even & ((mean - veil).abs() < kOffset + kRelative * veil).all(0);
}

}  // namespace apvi::mapping
