// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/display_exposure.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "gaussians/render/render.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kMaxViews = 16;
constexpr double kSurfaceAlpha = 0.8;
constexpr double kMinTransmission = 0.1;  // of the direct light; less amplifies noise too much
constexpr double kNorm = 6.0;
constexpr double kMaxBalance = 2.0;
constexpr double kUnsaturated = 0.995;      // fraction of pixels
constexpr double kShoulder = 0.8;           // values above are compressed
constexpr std::int64_t kMaxPixels = 20000;  // of a view

/// Restored colors [n,3] of a view where the surface is visible in all channels.
Tensor visible_colors(const Map& map, const gaussians::View& view) {
  const MapRendering rendering = render_map(map, view);
  Tensor visible = rendering.alpha > kSurfaceAlpha;
  if (map.medium) {
    const double strongest = map.medium->beta_d.max().item<double>();
    const Tensor range = gaussians::depth_to_range(rendering.depth, view.intrinsics);
    visible = visible & (range * strongest < -std::log(kMinTransmission));
  }
  const Tensor colors = rendering.restored.index({visible}).to(torch::kCPU, torch::kFloat64);
  const std::int64_t stride = std::max<std::int64_t>(1, colors.size(0) / kMaxPixels);
  return colors.slice(0, 0, colors.size(0), stride).clamp_min(0.0);
}

std::array<double, 3> balance_of(const Tensor& colors) {
  const Tensor level = colors.pow(kNorm).mean(0).pow(1.0 / kNorm).clamp_min(1e-6);
  const Tensor gain = (level.mean() / level).clamp(1.0 / kMaxBalance, kMaxBalance).contiguous();
  const double* const g = gain.data_ptr<double>();
  return {g[0], g[1], g[2]};
}

Tensor as_tensor(const std::array<double, 3>& rgb) {
  return torch::tensor({rgb[0], rgb[1], rgb[2]}, torch::kFloat64);
}

}  // namespace

DisplayExposure display_exposure(const Map& map, const std::vector<gaussians::View>& views,
                                 bool white_balance) {
  const torch::NoGradGuard no_grad;
  DisplayExposure exposure;
  if (views.empty()) return exposure;
  std::vector<Tensor> parts;
  const std::size_t stride = (views.size() + kMaxViews - 1) / kMaxViews;
  for (std::size_t k = 0; k < views.size(); k += stride)
    parts.push_back(visible_colors(map, views[k]));
  const Tensor colors = torch::cat(parts);
  if (colors.size(0) == 0) return exposure;
  if (white_balance) exposure.balance = balance_of(colors);
  const Tensor brightest = std::get<0>((colors * as_tensor(exposure.balance)).max(1));
  const auto rank =
      static_cast<std::int64_t>(std::ceil(kUnsaturated * static_cast<double>(brightest.size(0))));
  const double white =
      std::get<0>(brightest.kthvalue(std::max<std::int64_t>(1, rank))).item<double>();
  if (white > 1e-6) exposure.brightness = 1.0 / white;
  return exposure;
}

Tensor exposed(const Tensor& restored, const DisplayExposure& exposure) {
  return restored * as_tensor(exposure.gains()).to(restored.options());
}

Tensor displayed(const Tensor& restored, const DisplayExposure& exposure,
                 const gaussians::ToneCurve& curve) {
  const Tensor image = exposed(restored, exposure);
  const double room = 1.0 - kShoulder;
  const Tensor compressed = 1.0 - room * torch::exp(-(image - kShoulder) / room);
  return curve.encode(torch::where(image > kShoulder, compressed, image).clamp(0.0, 1.0));
}

}  // namespace apvi::mapping
