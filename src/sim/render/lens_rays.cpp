// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/lens_rays.hpp"

#include "apvi/core/error.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// A pixel without a ray gets a direction of zero.
WaterRay ray_of(const CameraModel& camera, const std::optional<PortCalibration>& port,
                const Vector2d& pixel) {
  WaterRay ray{Vector3d::Zero(), Vector3d::Zero()};
  if (!port) {
    ray.direction = camera.unproject(pixel).value_or(Vector3d::Zero());
  } else if (const auto bent = port->camera.ray(pixel)) {
    ray = {bent->origin + port->p_camera_lens, bent->direction};
  }
  return ray;
}

}  // namespace

Lens make_lens(const CameraModel& camera, const std::optional<PortCalibration>& port) {
  const auto& p = camera.parameters();
  if (p.width < 2 || p.height < 2)
    fail_input("camera: an image of {} x {} px cannot be rendered", p.width, p.height);
  Lens lens{.width = p.width, .height = p.height, .rays = {}, .origins = {}, .angle = {}};
  const auto count = static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height);
  lens.rays.reserve(count);
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const WaterRay ray = ray_of(camera, port, {x, y});
      lens.rays.emplace_back(ray.direction.cast<float>());
      if (port) lens.origins.emplace_back(ray.origin.cast<float>());
    }
  }
  lens.angle.reserve(count);
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const int neighbor = x + 1 < p.width ? x + 1 : x - 1;
      lens.angle.push_back(
          (lens.rays[lens.index(neighbor, y)] - lens.rays[lens.index(x, y)]).norm());
    }
  }
  return lens;
}

}  // namespace apvi::sim
