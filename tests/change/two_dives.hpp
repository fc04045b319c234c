// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "change/session.hpp"
#include "gaussians/model/point_cloud.hpp"

/// Sessions over a textured floor whose objects are known in closed form.
namespace apvi::test {

/// Opaque flat Gaussians at `centers` [n,3] with a normal along `axis` and these colors [n,3].
inline gaussians::Gaussians tiles(const torch::Tensor& centers, std::int64_t axis, double sigma_m,
                                  const torch::Tensor& colors) {
  const std::int64_t n = centers.size(0);
  torch::Tensor scales = torch::full({n, 3}, sigma_m).log();
  scales.select(1, axis).fill_(std::log(1e-4));
  return {.means = centers.to(torch::kFloat32),
          .log_scales = scales,
          .quaternions = torch::tensor({1.0F, 0.0F, 0.0F, 0.0F}).repeat({n, 1}),
          .logit_opacities = torch::full({n}, 4.0F),
          .sh_dc = gaussians::color_to_sh_dc(colors.to(torch::kFloat32)),
          .sh_rest = torch::zeros({n, 0, 3})};
}

inline gaussians::Gaussians joined(const gaussians::Gaussians& a, const gaussians::Gaussians& b) {
  gaussians::Gaussians out = a;
  for (std::size_t i = 0; i < out.tensors().size(); ++i) {
    *out.tensors()[i] = torch::cat({*a.tensors()[i], *b.tensors()[i]});
  }
  return out;
}

/// Centers [n,3] of a lattice over [-half, half] in two axes around `center`.
inline torch::Tensor lattice(const std::vector<double>& center, std::int64_t axis, double half_u,
                             double half_v, double spacing) {
  const auto line = [spacing](double half) {
    const auto count = static_cast<std::int64_t>(std::round(2.0 * half / spacing));
    return (torch::arange(count, torch::kFloat64) + 0.5) * spacing - half;
  };
  const auto grid = torch::meshgrid({line(half_u), line(half_v)}, "ij");
  std::vector<torch::Tensor> columns(3, torch::zeros_like(grid[0]));
  columns[static_cast<std::size_t>((axis + 1) % 3)] = grid[0];
  columns[static_cast<std::size_t>((axis + 2) % 3)] = grid[1];
  return torch::stack(columns, 2).view({-1, 3}) + torch::tensor(center, torch::kFloat64);
}

/// Smooth colors in [0.2, 0.6] that identify places [n,3].
inline torch::Tensor texture(const torch::Tensor& p) {
  const torch::Tensor x = p.select(1, 0);
  const torch::Tensor y = p.select(1, 1);
  const auto wave = [&](double a, double b, double c) { return (a * x + b * y + c).sin(); };
  const torch::Tensor gray = 0.4 + 0.05 * wave(21, 8, 0) + 0.05 * wave(-9, 24, 1) +
                             0.05 * wave(13, -17, 2) + 0.05 * wave(5, 6, 3);
  return torch::stack({gray, 0.9 * gray, 0.7 * gray}, 1);
}

inline gaussians::Gaussians floor_at(double height_m, double half_m = 1.6) {
  const torch::Tensor centers = lattice({0.0, 0.0, height_m}, 2, half_m, half_m, 0.02);
  return tiles(centers, 2, 0.014, texture(centers));
}

/// The five visible faces of a box of side `side_m` standing on the floor.
inline gaussians::Gaussians box_on(double height_m, double x, double y, double side_m) {
  const double half = 0.5 * side_m;
  const double middle = height_m + half;
  const auto face = [&](const std::vector<double>& center, std::int64_t axis) {
    const torch::Tensor centers = lattice(center, axis, half, half, 0.01);
    return tiles(centers, axis, 0.007, torch::full({centers.size(0), 3}, 0.5));
  };
  gaussians::Gaussians out = face({x, y, height_m + side_m}, 2);
  for (const double sign : {-1.0, 1.0}) {
    out = joined(out, face({x + sign * half, y, middle}, 0));
    out = joined(out, face({x, y + sign * half, middle}, 1));
  }
  return out;
}

/// Multiplies red by `factor` within `radius_m` of (x, y).
inline void stain(gaussians::Gaussians& g, double x, double y, double radius_m, double factor) {
  const torch::Tensor inside =
      torch::hypot(g.means.select(1, 0) - x, g.means.select(1, 1) - y) < radius_m;
  const torch::Tensor red = gaussians::sh_dc_to_color(g.sh_dc.select(1, 0));
  g.sh_dc.select(1, 0).copy_(gaussians::color_to_sh_dc(torch::where(inside, factor * red, red)));
}

/// Multiplies all colors by `factor` within `radius_m` of (x, y).
inline void shade(gaussians::Gaussians& g, double x, double y, double radius_m, double factor) {
  const torch::Tensor inside =
      torch::hypot(g.means.select(1, 0) - x, g.means.select(1, 1) - y) < radius_m;
  const torch::Tensor color = gaussians::sh_dc_to_color(g.sh_dc);
  g.sh_dc = gaussians::color_to_sh_dc(torch::where(inside.unsqueeze(1), factor * color, color));
}

/// Cameras 2 m above z = -2 between two x; they look down, in turn turned to the east and to the
/// west by `turn` [rad].
inline std::vector<gaussians::View> views_over(double from, double to, double turn = 0.35) {
  std::vector<gaussians::View> views;
  for (double x = from; x <= to + 1e-9; x += 0.5) {
    for (double y = -0.75; y <= 0.76; y += 0.5) {
      const double tilt = views.size() % 2 == 0 ? turn : -turn;
      const double c = std::cos(tilt);
      const double s = std::sin(tilt);
      const torch::Tensor R =
          torch::tensor({{c, 0.0, s}, {0.0, -1.0, 0.0}, {s, 0.0, -c}}, torch::kFloat64);
      gaussians::View view;
      view.intrinsics = {
          .fx = 130.0, .fy = 130.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
      view.T_camera_world = torch::eye(4, torch::kFloat64);
      view.T_camera_world.slice(0, 0, 3).slice(1, 0, 3).copy_(R);
      view.T_camera_world.slice(0, 0, 3).select(1, 3).copy_(
          -R.mv(torch::tensor({x, y, 0.0}, torch::kFloat64)));
      views.push_back(view);
    }
  }
  return views;
}

inline change::Session session(const gaussians::Gaussians& gaussians,
                               const std::vector<gaussians::View>& views = views_over(-1.0, 1.0)) {
  change::Session out{.map = {}, .views = views};
  out.map.gaussians = gaussians;
  return out;
}

}  // namespace apvi::test
