// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/surface_depth.hpp"

#include <torch/torch.h>

#include <utility>

#include "apvi/mapping/seeds.hpp"
#include "apvi/splat/ply.hpp"
#include "apvi/splat/render.hpp"
#include "blur.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kLeastAlpha = 1e-3;
constexpr double kSlopePx = 2.0;      // sigma of the blur before a surface's slope is taken
constexpr double kLargestStep = 0.1;  // relative change that is an edge and no slope

/// Where the centres of the Gaussians are drawn [N,2], in widths and heights of the picture.
Tensor centers_in(const Tensor& means, splat::View view) {
  view.T_camera_world = view.T_camera_world.to(means.options());
  const splat::Intrinsics& k = view.intrinsics;
  const Tensor size = torch::tensor({k.width, k.height}, means.options());
  return project(view, means).pixels / size;
}

/// Along the second and the first dimension of [H,W], per pixel; zero across the edges.
std::pair<Tensor, Tensor> slopes(const Tensor& image) {
  Tensor by_u = torch::zeros_like(image);
  Tensor by_v = torch::zeros_like(image);
  by_u.slice(1, 1, -1).copy_(0.5 * (image.slice(1, 2) - image.slice(1, 0, -2)));
  by_v.slice(0, 1, -1).copy_(0.5 * (image.slice(0, 2) - image.slice(0, 0, -2)));
  return {by_u, by_v};
}

}  // namespace

Tensor surface_depth(const Map& map, const splat::View& view, const Tensor& depth,
                     const Tensor& alpha) {
  const torch::NoGradGuard no_grad;
  const splat::Intrinsics& k = view.intrinsics;
  // Colours are not negative: a picture's width before its left edge is 0, one behind the right 1.
  const Tensor centers = ((centers_in(map.gaussians.means, view) + 1.0) / 3.0).clamp(0.0, 1.0);
  splat::Gaussians painted = map.gaussians;
  painted.sh_dc = splat::color_to_sh_dc(torch::cat({centers, centers.slice(1, 0, 1)}, 1));
  const Tensor drawn =
      splat::render(painted, view,
                    {.sh_degree = 0, .antialiased = map.antialiased, .background = {}})
          .color;
  const Tensor mean = 3.0 * drawn / alpha.clamp_min(kLeastAlpha).unsqueeze(2) - 1.0;
  const Tensor u = torch::arange(k.width, depth.options()) + 0.5;
  const Tensor v = (torch::arange(k.height, depth.options()) + 0.5).unsqueeze(1);

  const Tensor known = depth > 0.0;
  const auto [by_u, by_v] = slopes(blurred_inverse_depth(depth, kSlopePx));
  const Tensor carried = depth.clamp_min(1e-6).reciprocal() -
                         by_u * (k.width * mean.select(2, 0) - u) -
                         by_v * (k.height * mean.select(2, 1) - v);
  const Tensor there = 1.0 / carried.clamp_min(1e-6);
  const Tensor smooth = known & ((there - depth).abs() < kLargestStep * depth);
  return torch::where(smooth, there, depth);
}

}  // namespace apvi::mapping
