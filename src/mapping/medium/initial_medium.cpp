// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/initial_medium.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <vector>

#include "gaussians/render/render.hpp"
#include "medium/medium_initialization.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kImages = 8;
constexpr int kReduction = 2;
constexpr double kSurfaceAlpha = 0.3;  // initial Gaussians are nearly transparent

}  // namespace

medium::Medium initial_medium(const gaussians::Gaussians& initial, const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  const auto& training = keyframes.training();
  const std::size_t stride = std::max<std::size_t>(1, training.size() / kImages);
  std::vector<Tensor> colors;
  std::vector<Tensor> ranges;
  for (std::size_t i = 0; i < training.size(); i += stride) {
    const gaussians::View view = keyframes.view(training[i], kReduction);
    const gaussians::RenderOutput out = gaussians::render(initial, view, {});
    Tensor color = keyframes.image(training[i], kReduction, out.color.device());
    Tensor range = gaussians::depth_to_range(out.depth, view.intrinsics)
                       .masked_fill(out.alpha < kSurfaceAlpha, 0.0);
    const Tensor scene = keyframes.scene(training[i], kReduction, color.device());
    if (scene.defined()) {  // as a row of pixels
      color = color.masked_select(scene.unsqueeze(2)).reshape({1, -1, 3});
      range = range.masked_select(scene).unsqueeze(0);
    }
    colors.push_back(color);
    ranges.push_back(range);
  }
  return medium::initialize_medium(colors, ranges);
}

}  // namespace apvi::mapping
