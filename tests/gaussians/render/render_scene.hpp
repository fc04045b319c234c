// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <cstdint>

#include "gaussians/render/raster_backend.hpp"
#include "gaussians/render/render.hpp"

/// Random Gaussians in front of a camera, for rasterizer tests.
namespace apvi::gaussians::test {

inline constexpr double kPi = 3.14159265358979323846;

/// A camera slightly rotated and translated, with an off-center principal point.
inline View make_view(int width = 37, int height = 29) {
  const double angle = 0.2;
  View view;
  view.intrinsics = {.fx = 0.9 * width,
                     .fy = 1.1 * width,
                     .cx = 0.5 * width + 0.7,
                     .cy = 0.5 * height - 0.4,
                     .width = width,
                     .height = height};
  view.T_camera_world = torch::tensor({std::cos(angle), 0.0, std::sin(angle), 0.1,   //
                                       0.0, 1.0, 0.0, -0.2,                          //
                                       -std::sin(angle), 0.0, std::cos(angle), 0.3,  //
                                       0.0, 0.0, 0.0, 1.0},
                                      torch::kFloat64)
                            .reshape({4, 4});
  return view;
}

/// `count` Gaussians about 2 to 6 m ahead, of many shapes and sizes, half transparent.
inline Gaussians make_gaussians(std::int64_t count, torch::ScalarType type = torch::kFloat64,
                                int sh_degree = 3, int seed = 1) {
  torch::manual_seed(static_cast<std::uint64_t>(seed));
  const auto f64 = torch::dtype(torch::kFloat64);
  const torch::Tensor position = torch::rand({count, 3}, f64);
  const torch::Tensor z = 2.0 + 4.0 * position.select(1, 2);
  const torch::Tensor x = (position.select(1, 0) - 0.5) * z * 1.2 - 0.2 * z;
  const torch::Tensor y = (position.select(1, 1) - 0.5) * z * 1.0;
  Gaussians out = {
      .means = torch::stack({x, y, z}, 1),
      .log_scales = torch::rand({count, 3}, f64) * 2.0 - 3.0,
      .quaternions = torch::randn({count, 4}, f64),
      .logit_opacities = torch::randn({count}, f64),
      .sh_dc = torch::randn({count, 3}, f64) * 0.5 + 1.0,
      .sh_rest = torch::randn({count, sh_rest_count(sh_degree), 3}, f64) * 0.1,
  };
  for (torch::Tensor* tensor : out.tensors()) *tensor = tensor->to(type).contiguous();
  return out;
}

/// Rasterizer input with a colored background.
inline RasterInput raster_input(const Gaussians& gaussians, const View& view,
                                bool antialiased = false) {
  return {.gaussians = gaussians,
          .background = torch::tensor({0.2, 0.5, 0.8}).to(gaussians.means.options()),
          .T_camera_world = view.T_camera_world,
          .intrinsics = view.intrinsics,
          .sh_degree = gaussians.sh_degree(),
          .near_m = 0.01,
          .low_pass_px2 = 0.3,
          .antialiased = antialiased};
}

inline Gaussians map_tensors(const Gaussians& from,
                             const std::function<torch::Tensor(const torch::Tensor&)>& f) {
  Gaussians out;
  for (std::size_t i = 0; i < 6; ++i) *out.tensors()[i] = f(*from.tensors()[i]);
  return out;
}

}  // namespace apvi::gaussians::test
