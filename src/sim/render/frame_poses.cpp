// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/frame_poses.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr float kMaxRange = 200.0F;  // [m]; beyond the visibility of any water

/// Offset of the k-th exposure sample from the pixel center, in pixels: zero for the middle sample,
/// spread for the others, so that motion blur also antialiases edges.
Vector2d pixel_offset(int k, int count) {
  if (2 * k + 1 == count) return Vector2d::Zero();
  const double angle = 2.399963 * k;
  return 0.35 * Vector2d(std::cos(angle), std::sin(angle));
}

// About one sample per pixel of image motion during the exposure; an odd number, so that one of
// them is at mid-exposure.
int count_samples(const ImageRequest& request, const ExposureSetup& setup) {
  const auto& p = setup.camera.parameters();
  const Duration half = Duration::from_seconds(0.5 * setup.effects.exposure_s);
  const SE3 T_start = request.T_world_camera(request.stamp - half);
  const SE3 T_end_inverse = request.T_world_camera(request.stamp + half).inverse();
  double motion = 0.0;
  for (const double fy : {0.1, 0.5, 0.9}) {
    for (const double fx : {0.1, 0.5, 0.9}) {
      const Vector2d pixel(fx * p.width, fy * p.height);
      const auto ray = setup.camera.unproject(pixel);
      if (!ray) continue;
      const auto hit = setup.world.cast(T_start.translation, T_start.rotation * *ray, 20.0);
      const Vector3d point = T_start * Vector3d((hit ? hit->range : 20.0) * *ray);
      const auto later = setup.camera.project(T_end_inverse * point);
      if (later) motion = std::max(motion, (*later - pixel).norm());
    }
  }
  const int wanted = 1 + 2 * static_cast<int>(std::ceil(0.5 * (std::min(motion, 100.0) - 0.75)));
  return std::clamp(wanted, 1, (setup.effects.blur_samples - 1) / 2 * 2 + 1);
}

}  // namespace

FramePoses frame_poses(const ImageRequest& request, const ExposureSetup& setup) {
  FramePoses result;
  result.samples = count_samples(request, setup);
  const int height = setup.camera.parameters().height;
  const bool rolling = setup.effects.shutter == Shutter::rolling;
  result.rows = rolling ? static_cast<std::size_t>(height) : 1;
  for (int k = 0; k < result.samples; ++k) {
    const double phase = (k + 0.5) / result.samples - 0.5;
    for (std::size_t row = 0; row < result.rows; ++row) {
      const double place = rolling ? (static_cast<double>(row) + 0.5) / height - 0.5 : 0.0;
      const double offset = phase * setup.effects.exposure_s + place * setup.effects.readout_s;
      result.poses.push_back(
          request.T_world_camera(request.stamp + Duration::from_seconds(offset)));
    }
  }
  return result;
}

void fill_rays(const Lens& lens, const FramePoses& poses, int sample, const cv::Rect& tile,
               TileRays& out) {
  const Vector2d shift = pixel_offset(sample, poses.samples);
  out.rays.resize(static_cast<std::size_t>(tile.area()));
  std::size_t i = 0;
  for (int y = tile.y; y < tile.y + tile.height; ++y) {
    const SE3& T_world_camera = poses.at(sample, y);
    const Eigen::Matrix3f R = T_world_camera.rotation.toRotationMatrix().cast<float>();
    const Vector3f center = T_world_camera.translation.cast<float>();
    const int y2 = y + 1 < lens.height ? y + 1 : y - 1;
    for (int x = tile.x; x < tile.x + tile.width; ++x, ++i) {
      const Vector3f& ray = lens.rays[lens.index(x, y)];
      Vector3f d = ray;
      if (sample * 2 + 1 != poses.samples) {
        const int x2 = x + 1 < lens.width ? x + 1 : x - 1;
        const auto sx = static_cast<float>(shift.x());
        const auto sy = static_cast<float>(shift.y());
        d += sx * (lens.rays[lens.index(x2, y)] - ray) + sy * (lens.rays[lens.index(x, y2)] - ray);
        d.normalize();
      }
      const Vector3f world = R * d;
      const Vector3f origin =
          lens.origins.empty() ? center : Vector3f(center + R * lens.origins[lens.index(x, y)]);
      out.rays.ox[i] = origin.x();
      out.rays.oy[i] = origin.y();
      out.rays.oz[i] = origin.z();
      out.rays.dx[i] = world.x();
      out.rays.dy[i] = world.y();
      out.rays.dz[i] = world.z();
      // Pixels without a ray get a tiny range and hit nothing.
      out.rays.range[i] = ray.isZero() ? 1e-3F : kMaxRange;
      out.pixel_angle[static_cast<int>(i)] = lens.angle[lens.index(x, y)];
    }
  }
}

}  // namespace apvi::sim
