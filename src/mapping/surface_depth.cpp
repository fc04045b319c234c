// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/surface_depth.hpp"

#include <torch/torch.h>

#include <utility>

#include "gaussians/model/point_cloud.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/blur.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kAlphaEpsilon = 1e-3;
constexpr double kSlopePx = 2.0;          // standard deviation of the blur before differentiation
constexpr double kMaxRelativeStep = 0.1;  // larger relative changes are depth edges

/// Image positions of the Gaussian centers [N,2], in widths and heights of the image.
Tensor centers_in(const Tensor& means, gaussians::View view) {
  view.T_camera_world = view.T_camera_world.to(means.options());
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor size = torch::tensor({k.width, k.height}, means.options());
  return project(view, means).pixels / size;
}

/// Central differences along the second and the first dimension of [H,W], per pixel; zero at the
/// border.
std::pair<Tensor, Tensor> slopes(const Tensor& image) {
  Tensor by_u = torch::zeros_like(image);
  Tensor by_v = torch::zeros_like(image);
  by_u.slice(1, 1, -1).copy_(0.5 * (image.slice(1, 2) - image.slice(1, 0, -2)));
  by_v.slice(0, 1, -1).copy_(0.5 * (image.slice(0, 2) - image.slice(0, 0, -2)));
  return {by_u, by_v};
}

}  // namespace

Tensor surface_depth(const Map& map, const gaussians::View& view, const Tensor& depth,
                     const Tensor& alpha) {
  const torch::NoGradGuard no_grad;
  const gaussians::Intrinsics& k = view.intrinsics;
  // Colors must not be negative: one image width left of the image maps to 0, one right of it to 1.
  const Tensor centers = ((centers_in(map.gaussians.means, view) + 1.0) / 3.0).clamp(0.0, 1.0);
  gaussians::Gaussians painted = map.gaussians;
  painted.sh_dc = gaussians::color_to_sh_dc(torch::cat({centers, centers.slice(1, 0, 1)}, 1));
  const Tensor drawn =
      gaussians::render(painted, view,
                        {.sh_degree = 0, .antialiased = map.antialiased, .background = {}})
          .color;
  const Tensor mean = 3.0 * drawn / alpha.clamp_min(kAlphaEpsilon).unsqueeze(2) - 1.0;
  const Tensor u = torch::arange(k.width, depth.options()) + 0.5;
  const Tensor v = (torch::arange(k.height, depth.options()) + 0.5).unsqueeze(1);

  const Tensor known = depth > 0.0;
  const auto [by_u, by_v] = slopes(blurred_inverse_depth(depth, kSlopePx));
  const Tensor carried = depth.clamp_min(1e-6).reciprocal() -
                         by_u * (k.width * mean.select(2, 0) - u) -
                         by_v * (k.height * mean.select(2, 1) - v);
  const Tensor there = 1.0 / carried.clamp_min(1e-6);
  const Tensor smooth = known & ((there - depth).abs() < kMaxRelativeStep * depth);
  return torch::where(smooth, there, depth);
}

}  // namespace apvi::mapping
