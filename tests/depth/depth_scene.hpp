// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <array>
#include <cmath>
#include <vector>

#include "depth/depth.hpp"

/// Textured planes seen by pinhole cameras, evaluated per pixel.
namespace apvi::depth::test {

/// n x = offset in the world [m].
struct Plane {
  std::array<double, 3> n;
  double offset;
};

inline gaussians::Intrinsics small_camera() {
  return {.fx = 160.0, .fy = 160.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
}

/// Multi-scale texture of the world in [0.1, 0.9]. `strength` below 1 reduces contrast.
inline double pattern(double x, double y, double z, double strength) {
  double sum = 0.0;
  double size = 0.6;
  double direction = 0.3;
  for (int k = 0; k < 10; ++k) {
    const double a = 2.0 * M_PI / size;
    sum += std::sin(a * (std::cos(direction) * x + std::sin(direction) * y) + 1.7 * k + a * z);
    size /= 1.45;
    direction += 2.4;
  }
  return 0.5 + strength * 0.4 * std::tanh(0.5 * sum);
}

/// A camera at `place` [m] looking along z, rotated by `yaw` about its y axis.
inline gaussians::View camera_at(double x, double y, double z, double yaw = 0.0) {
  const double c = std::cos(yaw);
  const double s = std::sin(yaw);
  torch::Tensor T =
      torch::tensor({c, 0.0, -s, 0.0, 0.0, 1.0, 0.0, 0.0, s, 0.0, c, 0.0, 0.0, 0.0, 0.0, 1.0},
                    torch::kFloat64)
          .reshape({4, 4});
  const torch::Tensor center = torch::tensor({x, y, z}, torch::kFloat64);
  T.slice(0, 0, 3).select(1, 3) = -T.slice(0, 0, 3).slice(1, 0, 3).mv(center);
  return {.intrinsics = small_camera(), .T_camera_world = T, .pose_delta = {}};
}

/// Depth [H,W] of the plane along the optical axis; 0 where the plane is not visible.
inline torch::Tensor depth_of(const Plane& plane, const gaussians::View& view) {
  const gaussians::Intrinsics& k = view.intrinsics;
  torch::Tensor depth = torch::zeros({k.height, k.width}, torch::kFloat32);
  const torch::Tensor T = torch::inverse(view.T_camera_world);
  const auto m = T.accessor<double, 2>();
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const std::array<double, 3> ray = {(u + 0.5 - k.cx) / k.fx, (v + 0.5 - k.cy) / k.fy, 1.0};
      double along = 0.0;
      double left = plane.offset;
      for (int i = 0; i < 3; ++i) {
        left -= plane.n[static_cast<std::size_t>(i)] * m[i][3];
        for (int j = 0; j < 3; ++j) {
          along +=
              plane.n[static_cast<std::size_t>(i)] * m[i][j] * ray[static_cast<std::size_t>(j)];
        }
      }
      if (left / along > 0.0) depth[v][u] = left / along;
    }
  }
  return depth;
}

/// Image [H,W] of the plane. `gain` scales all intensities.
inline DepthView look(const Plane& plane, const gaussians::View& view, double strength = 1.0,
                      double gain = 1.0) {
  const gaussians::Intrinsics& k = view.intrinsics;
  torch::Tensor gray = torch::zeros({k.height, k.width}, torch::kFloat32);
  const torch::Tensor depth = depth_of(plane, view);
  const torch::Tensor T = torch::inverse(view.T_camera_world);
  const auto m = T.accessor<double, 2>();
  const auto z = depth.accessor<float, 2>();
  auto out = gray.accessor<float, 2>();
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double d = static_cast<double>(z[v][u]);
      const std::array<double, 3> p = {(u + 0.5 - k.cx) / k.fx * d, (v + 0.5 - k.cy) / k.fy * d, d};
      std::array<double, 3> world = {};
      for (int i = 0; i < 3; ++i) {
        world[static_cast<std::size_t>(i)] =
            m[i][0] * p[0] + m[i][1] * p[1] + m[i][2] * p[2] + m[i][3];
      }
      out[v][u] = static_cast<float>(gain * pattern(world[0], world[1], world[2], strength));
    }
  }
  return {.gray = gray, .camera = view};
}

/// Six images from positions in a row, the first from the middle.
inline DepthRequest walk_along(const Plane& plane, double strength = 1.0) {
  DepthRequest request;
  for (const double x : {0.0, -0.1, 0.1, 0.2, -0.2, 0.3}) {
    request.views.push_back(look(plane, camera_at(x, 0.02 * x, 0.1 * x, 0.05 * x), strength));
  }
  return request;
}

/// Relative errors of the blocks' depths [B], against the true depth [H,W] at their centers.
inline torch::Tensor block_errors(const DepthEstimate& estimate, const torch::Tensor& truth) {
  std::vector<float> errors;
  for (std::size_t i = 0; i < estimate.blocks.size(); ++i) {
    const Block& b = estimate.blocks[i];
    const auto k = static_cast<std::int64_t>(i);
    const int x0 = b.x + (b.width - 1) / 2;  // the center is between pixels
    const int y0 = b.y + (b.height - 1) / 2;
    const int x1 = b.x + b.width / 2;
    const int y1 = b.y + b.height / 2;
    const float inverse =
        0.5F * (1.0F / truth[y0][x0].item<float>() + 1.0F / truth[y1][x1].item<float>());
    errors.push_back(std::abs(estimate.depth[k].item<float>() * inverse - 1.0F));
  }
  return torch::tensor(errors);
}

}  // namespace apvi::depth::test
