// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <limits>
#include <vector>

#include "gaussians/render/render.hpp"

/// Independent reference rasterizer: a plain LibTorch expression over all pixels and Gaussians,
/// differentiated by autograd. Slow.
namespace apvi::test {

/// Spherical harmonics to degree 3 of unit directions [N,3], as [N,16].
inline torch::Tensor reference_sh(const torch::Tensor& d) {
  const auto x = d.select(1, 0);
  const auto y = d.select(1, 1);
  const auto z = d.select(1, 2);
  const auto r2 = x * x + y * y + z * z;
  const double pi = 3.14159265358979323846;
  const auto k = [pi](double numerator, double denominator) {
    return std::sqrt(numerator / (denominator * pi));
  };
  return torch::stack(
      {torch::full_like(x, 0.5 * k(1, 1)), -k(3, 4) * y, k(3, 4) * z, -k(3, 4) * x,
       k(15, 4) * x * y, -k(15, 4) * y * z, k(5, 16) * (3 * z * z - r2), -k(15, 4) * x * z,
       k(15, 16) * (x * x - y * y), -k(35, 32) * y * (3 * x * x - y * y), k(105, 4) * x * y * z,
       -k(21, 32) * y * (5 * z * z - r2), k(7, 16) * z * (5 * z * z - 3 * r2),
       -k(21, 32) * x * (5 * z * z - r2), k(105, 16) * z * (x * x - y * y),
       -k(35, 32) * x * (x * x - 3 * y * y)},
      1);
}

/// Rotation matrices [N,3,3] of unnormalized quaternions w x y z.
inline torch::Tensor reference_rotations(const torch::Tensor& quaternions) {
  const auto q = (quaternions / quaternions.norm(2, 1, true)).unbind(1);
  const auto &w = q[0], &x = q[1], &y = q[2], &z = q[3];
  return torch::stack({w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
                       2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
                       2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z},
                      1)
      .reshape({-1, 3, 3});
}

/// The pose that is rendered, differentiable in `pose_delta`.
inline torch::Tensor reference_pose(const gaussians::View& view) {
  if (!view.pose_delta.defined()) return view.T_camera_world;
  const auto d = view.pose_delta.unbind(0);
  const auto zero = torch::zeros_like(d[0]);
  const torch::Tensor twist = torch::stack({zero, -d[5], d[4], d[0], d[5], zero, -d[3], d[1], -d[4],
                                            d[3], zero, d[2], zero, zero, zero, zero})
                                  .reshape({4, 4});
  return torch::matrix_exp(twist).matmul(view.T_camera_world);
}

/// x/z clamped to the range over which the projection is linearized.
inline torch::Tensor reference_ray(const torch::Tensor& ray, double f, double c, int size) {
  const double margin = 0.15 * size;
  return ray.clamp(-(c + margin) / f, (size - c + margin) / f);
}

/// One row per Gaussian, sorted by depth.
struct ReferenceSplats {
  torch::Tensor u, v, z, covariance, opacity, color;
};

inline ReferenceSplats reference_project(const gaussians::Gaussians& g, const gaussians::View& view,
                                         const gaussians::RenderOptions& options) {
  const gaussians::Intrinsics& k = view.intrinsics;
  const torch::Tensor T = reference_pose(view);
  const torch::Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  const torch::Tensor t = T.slice(0, 0, 3).select(1, 3);
  const torch::Tensor p = g.means.matmul(R.t()) + t;
  const torch::Tensor z = p.select(1, 2);
  const torch::Tensor x = p.select(1, 0) / z;
  const torch::Tensor y = p.select(1, 1) / z;
  const torch::Tensor zero = torch::zeros_like(z);
  const torch::Tensor J =
      torch::stack({k.fx / z, zero, -k.fx * reference_ray(x, k.fx, k.cx, k.width) / z,  //
                    zero, k.fy / z, -k.fy * reference_ray(y, k.fy, k.cy, k.height) / z},
                   1)
          .reshape({-1, 2, 3});
  const torch::Tensor M = J.matmul(R).matmul(reference_rotations(g.quaternions)) *
                          torch::exp(g.log_scales).unsqueeze(1);
  const torch::Tensor sharp = M.matmul(M.transpose(1, 2));
  const torch::Tensor covariance = sharp + options.low_pass_px2 * torch::eye(2, z.options());
  torch::Tensor opacity = torch::sigmoid(g.logit_opacities);
  if (options.antialiased)
    opacity = opacity * torch::sqrt(torch::det(sharp) / torch::det(covariance));
  torch::Tensor direction = g.means + R.t().matmul(t);
  direction = direction / direction.norm(2, 1, true);
  const std::int64_t used = gaussians::sh_rest_count(std::min(options.sh_degree, g.sh_degree()));
  const torch::Tensor basis = reference_sh(direction);
  const torch::Tensor color =
      torch::relu(basis.slice(1, 0, 1) * g.sh_dc + 0.5 +
                  (basis.slice(1, 1, 1 + used).unsqueeze(-1) * g.sh_rest.slice(1, 0, used)).sum(1));
  const torch::Tensor order =
      std::get<1>(z.detach().sort(/*stable=*/true, /*dim=*/0, /*descending=*/false));
  const torch::Tensor kept = order.index({z.detach().index({order}) >= options.near_m});
  const auto pick = [&kept](const torch::Tensor& a) { return a.index_select(0, kept); };
  return {pick(k.fx * x + k.cx), pick(k.fy * y + k.cy), pick(z),
          pick(covariance),      pick(opacity),         pick(color)};
}

struct ReferenceImage {
  torch::Tensor color, depth, alpha;
  torch::Tensor max_weight;  ///< [kept Gaussians] by depth
};

inline ReferenceImage reference_render(const gaussians::Gaussians& g, const gaussians::View& view,
                                       const gaussians::RenderOptions& options) {
  const ReferenceSplats s = reference_project(g, view, options);
  const auto f64 = s.u.options().requires_grad(false);
  const torch::Tensor dx =
      (torch::arange(view.intrinsics.width, f64) + 0.5).reshape({1, -1, 1}) - s.u;
  const torch::Tensor dy =
      (torch::arange(view.intrinsics.height, f64) + 0.5).reshape({-1, 1, 1}) - s.v;
  const torch::Tensor conic = torch::inverse(s.covariance);
  const auto entry = [&conic](int i, int j) { return conic.select(1, i).select(1, j); };
  const torch::Tensor sigma =
      0.5 * (entry(0, 0) * dx * dx + entry(1, 1) * dy * dy) + entry(0, 1) * dx * dy;
  torch::Tensor alpha = torch::clamp_max(s.opacity * torch::exp(-sigma), 0.999);
  alpha = torch::where(alpha >= 1.0 / 255.0, alpha, torch::zeros_like(alpha));
  const torch::Tensor after = torch::cumprod(1.0 - alpha, 2);
  alpha = torch::where(after > 1e-4, alpha, torch::zeros_like(alpha));
  const torch::Tensor through = torch::cumprod(1.0 - alpha, 2);
  const torch::Tensor before =
      torch::cat({torch::ones_like(through.slice(2, 0, 1)), through.slice(2, 0, -1)}, 2);
  const torch::Tensor weight = before * alpha;
  const torch::Tensor opacity = weight.sum(2);
  torch::Tensor color = weight.matmul(s.color);
  if (options.background.defined()) {
    color = color + (1.0 - opacity).unsqueeze(-1) * options.background;
  }
  const torch::Tensor hit = opacity > 0;
  const torch::Tensor depth = torch::where(
      hit, (weight * s.z).sum(2) / torch::where(hit, opacity, torch::ones_like(opacity)),
      torch::zeros_like(opacity));
  return {color, depth, opacity, weight.detach().amax({0, 1})};
}

}  // namespace apvi::test
