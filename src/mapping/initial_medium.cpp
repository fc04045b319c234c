// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/initial_medium.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <vector>

#include "apvi/splat/medium_estimate.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kImages = 8;
constexpr int kReduction = 2;
constexpr double kSolid = 0.3;  // the first Gaussians are faint

}  // namespace

splat::Medium initial_medium(const splat::Gaussians& initial, const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  const auto& training = keyframes.training();
  const std::size_t stride = std::max<std::size_t>(1, training.size() / kImages);
  std::vector<Tensor> colors;
  std::vector<Tensor> ranges;
  for (std::size_t i = 0; i < training.size(); i += stride) {
    const splat::View view = keyframes.view(training[i], kReduction);
    const splat::RenderOutput out = splat::render(initial, view, {});
    const Tensor range = splat::depth_to_range(out.depth, view.intrinsics);
    colors.push_back(keyframes.image(training[i], kReduction, out.color.device()));
    ranges.push_back(range.masked_fill(out.alpha < kSolid, 0.0));
  }
  return splat::estimate_medium(colors, ranges);
}

}  // namespace apvi::mapping
