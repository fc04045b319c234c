// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/view_cone.hpp"

#include <torch/torch.h>

#include <cmath>

namespace apvi::gaussians {

// Plain numbers instead of tensors: this is done for many keyframes at each new one.
Sphere to_camera(const torch::Tensor& T_camera_world, const Sphere& in_world) {
  const auto T = T_camera_world.accessor<double, 2>();
  Sphere out{{}, in_world.radius_m};
  for (int row = 0; row < 3; ++row) {
    double sum = T[row][3];
    for (std::size_t k = 0; k < 3; ++k) {
      sum += T[row][static_cast<std::int64_t>(k)] * in_world.center[k];
    }
    out.center[static_cast<std::size_t>(row)] = sum;
  }
  return out;
}

Sphere to_world(const torch::Tensor& T_camera_world, const Sphere& in_camera) {
  const auto T = T_camera_world.accessor<double, 2>();
  Sphere out{{}, in_camera.radius_m};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto column = static_cast<std::int64_t>(axis);
    for (int row = 0; row < 3; ++row) {
      const double offset = in_camera.center[static_cast<std::size_t>(row)] - T[row][3];
      out.center[axis] += T[row][column] * offset;
    }
  }
  return out;
}

bool may_see(const Intrinsics& camera, const Sphere& in_camera, double far_m) {
  const auto [x, y, z] = in_camera.center;
  const double r = in_camera.radius_m;
  if (z < -r || std::hypot(x, y, z) - r > far_m) return false;
  // Distance inside the plane through the camera's center and the border of the image.
  const auto inside = [z = z](double f, double offset, double value) {
    return (f * value + offset * z) / std::hypot(f, offset);
  };
  return inside(camera.fx, camera.cx, x) > -r &&
         inside(-camera.fx, camera.width - camera.cx, x) > -r &&
         inside(camera.fy, camera.cy, y) > -r &&
         inside(-camera.fy, camera.height - camera.cy, y) > -r;
}

}  // namespace apvi::gaussians
