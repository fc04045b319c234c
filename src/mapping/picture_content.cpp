// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/picture_content.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kBlackLevel = 3.0;  // grey levels of 255: mean and spread in the dark

constexpr std::int64_t kSquares = 80;   // along a picture's width
constexpr std::int64_t kLeastSide = 4;  // [px] else noise and detail look alike
constexpr std::int64_t kAround = 5;     // squares
constexpr std::int64_t kStride = 2;     // [px] neighbours are alike where colours are interpolated
constexpr std::int64_t kRows = 4;       // one in so many is looked at for noise
constexpr double kShown = 0.9;          // quantile
constexpr double kMedianOfNormal = 0.6745;  // sigmas
constexpr double kSaturated = 254.0;        // grey levels
constexpr double kQuantised = 0.29;         // grey levels: a byte's own noise
constexpr double kNoisiest = 6.0;           // grey levels: what is more is fine texture

/// [H,W] float32 of bytes [H,W,3]. Channel by channel: a mean over so few is slow.
Tensor grey_of(const Tensor& image) {
  const auto channel = [&image](std::int64_t c) { return image.select(2, c).to(torch::kFloat32); };
  return (channel(0) + channel(1) + channel(2)) / 3.0;
}

/// Of one pixel [grey levels], by second differences along rows; some rows tell.
double noise_of(const Tensor& grey) {
  const std::int64_t w = grey.size(1);
  const Tensor rows = grey.slice(0, 0, grey.size(0), kRows);
  const Tensor difference = rows.slice(1, 0, w - 2 * kStride) -
                            2.0 * rows.slice(1, kStride, w - kStride) +
                            rows.slice(1, 2 * kStride, w);
  const double median = difference.abs().median().item<double>();
  return std::clamp(median / (kMedianOfNormal * std::sqrt(6.0)), kQuantised, kNoisiest);
}

}  // namespace

bool is_black(const Tensor& image) {
  const Tensor grey = image.to(torch::kFloat32);
  return grey.mean().item<double>() < kBlackLevel && grey.std().item<double>() < kBlackLevel;
}

bool is_murky(const Tensor& image) {
  const Tensor grey = grey_of(image);
  if ((grey >= kSaturated).to(torch::kFloat32).mean().item<double>() > 0.5) return true;
  const std::int64_t side = image.size(1) / kSquares;
  if (side < kLeastSide || image.size(0) < kAround * side) return false;
  const Tensor squares = torch::avg_pool2d(grey.unsqueeze(0).unsqueeze(0), side);
  const std::int64_t edge = kAround / 2;
  const Tensor inner =
      squares.slice(2, edge, squares.size(2) - edge).slice(3, edge, squares.size(3) - edge);
  const Tensor detail = (inner - torch::avg_pool2d(squares, kAround, 1)).abs().flatten();
  const auto rank = static_cast<std::int64_t>(kShown * static_cast<double>(detail.numel() - 1));
  const double shown = std::get<0>(detail.kthvalue(rank + 1)).item<double>();
  return shown < noise_of(grey);
}

}  // namespace apvi::mapping
