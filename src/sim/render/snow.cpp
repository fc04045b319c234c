// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/snow.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kCell = 0.25;       // [m], size of the cells in which particles are generated
constexpr double kFocus = 2.0;       // [m], focus distance
constexpr double kAperture = 0.006;  // [m]

struct Particle {
  Vector3d position;  // world [m]
  double diameter;    // [m]
  double brightness;
};

struct Cell {
  int x, y, z;
};

std::uint32_t cell_key(const Cell& c, std::uint64_t seed) {
  const auto mixed = static_cast<std::uint32_t>(seed) * 0x9e3779b1U;
  return hash32(
      static_cast<std::uint32_t>(c.x),
      hash32(static_cast<std::uint32_t>(c.y), hash32(static_cast<std::uint32_t>(c.z), mixed)));
}

Particle make_particle(const SnowConfig& config, const Cell& cell, std::uint32_t key) {
  const auto random = [key](std::uint32_t k) {
    return static_cast<double>(unit_float(hash32(key, k)));
  };
  const double rare = random(4) * random(5) * random(6);  // few large particles, many small ones
  return {.position = kCell * Vector3d(cell.x + random(1), cell.y + random(2), cell.z + random(3)),
          .diameter = 1e-3 * config.size_mm * (0.6 + 4.0 * rare),
          .brightness = config.brightness * (0.5 + random(7))};
}

Vector3d drift(const SnowConfig& config, double time_s) {
  return time_s * Vector3d(config.current_m_s[0], config.current_m_s[1], config.current_m_s[2]);
}

// Bounding box of the view frustum up to `range`, in coordinates that drift with the water.
Eigen::AlignedBox3d view_box(const CameraModel& camera, const SE3& T_world_camera,
                             const Vector3d& shift, double range) {
  const auto& p = camera.parameters();
  Eigen::AlignedBox3d box(Vector3d(T_world_camera.translation - shift));
  for (int y = 0; y <= 4; ++y) {
    for (int x = 0; x <= 4; ++x) {
      const auto ray = camera.unproject({0.25 * x * p.width, 0.25 * y * p.height});
      if (ray) box.extend(T_world_camera * Vector3d(range * *ray) - shift);
    }
  }
  return box;
}

/// A Gaussian spot, in pixels.
struct Spot {
  Vector2d start, end;
  double sigma;
  double opacity;  ///< at the center
  double range;
  Vector3d color;
};

Vector3d particle_irradiance(const LightState& light, const Vector3d& p_world,
                             const Vector3d& p_camera) {
  Vector3d sum = daylight_at(light.config, light.medium, -p_world.z());
  if (light.config.lamp) {
    const auto& at = light.config.lamp->position_m;
    const Vector3d toward = (Vector3d(at[0], at[1], at[2]) - p_camera).normalized();
    sum += lamp_irradiance(*light.config.lamp, light.medium, p_camera, toward);
  }
  return sum;
}

void draw_spot(const Spot& spot, const cv::Mat& range, cv::Mat& linear) {
  const double length = (spot.end - spot.start).norm();
  const int steps =
      std::clamp(static_cast<int>(std::ceil(length / std::max(0.5, spot.sigma))), 1, 24);
  const int reach = static_cast<int>(std::ceil(2.5 * spot.sigma));
  const double scale = -0.5 / (spot.sigma * spot.sigma);
  for (int k = 0; k < steps; ++k) {
    const Vector2d at = spot.start + (k + 0.5) / steps * (spot.end - spot.start);
    const int cx = static_cast<int>(std::lround(at.x()));
    const int cy = static_cast<int>(std::lround(at.y()));
    for (int y = std::max(0, cy - reach); y <= std::min(linear.rows - 1, cy + reach); ++y) {
      for (int x = std::max(0, cx - reach); x <= std::min(linear.cols - 1, cx + reach); ++x) {
        const float behind = range.at<float>(y, x);
        if (behind > 0.0F && static_cast<double>(behind) < spot.range) continue;
        const double square = (Vector2d(x, y) - at).squaredNorm();
        const auto a = static_cast<float>(spot.opacity / steps * std::exp(scale * square));
        auto& pixel = linear.at<cv::Vec3f>(y, x);
        for (int c = 0; c < 3; ++c) {
          pixel[c] += a * (static_cast<float>(spot.color[2 - c]) - pixel[c]);
        }
      }
    }
  }
}

struct ExposurePoses {
  SE3 T_camera_world_start, T_camera_world_end;
};

void draw_particle(const Particle& particle, const SnowConfig& config, const SnowColor& color,
                   const CameraModel& camera, const ExposurePoses& poses, const cv::Mat& range,
                   cv::Mat& linear) {
  const Vector3d start = poses.T_camera_world_start * particle.position;
  const Vector3d end = poses.T_camera_world_end * particle.position;
  if (start.z() < 0.12 || end.z() < 0.12 || start.norm() > config.range_m) return;
  const auto from = camera.project(start);
  const auto to = camera.project(end);
  if (!from || !to || !camera.in_image(*from, -20.0)) return;
  const double focal = camera.parameters().fx;
  const double radius = 0.5 * focal * particle.diameter / start.z();
  const double blur = 0.5 * focal * kAperture * std::abs(1.0 / start.z() - 1.0 / kFocus);
  const double sigma = std::sqrt(0.36 + 0.4 * radius * radius + 0.25 * blur * blur);
  const double fade = std::min(1.0, 4.0 * (1.0 - start.norm() / config.range_m));
  const double opacity = 0.8 * fade * std::min(1.0, radius * radius / (2.0 * sigma * sigma));
  draw_spot({.start = *from,
             .end = *to,
             .sigma = sigma,
             .opacity = opacity,
             .range = start.norm(),
             .color = color(particle.position, start, particle.brightness)},
            range, linear);
}

}  // namespace

SnowColor snow_color(const LightState& light) {
  return [&light](const Vector3d& p_world, const Vector3d& p_camera, double brightness) {
    const Vector3d lit = brightness * particle_irradiance(light, p_world, p_camera);
    return apply_medium(light.medium, lit, p_camera.norm());
  };
}

void draw_snow(const SnowConfig& config, double time_s, const SnowColor& color,
               const CameraModel& camera, const SE3& T_world_camera_start,
               const SE3& T_world_camera_end, std::uint64_t seed, const cv::Mat& range,
               cv::Mat& linear) {
  if (config.density_per_m3 <= 0.0) return;
  const ExposurePoses poses{.T_camera_world_start = T_world_camera_start.inverse(),
                            .T_camera_world_end = T_world_camera_end.inverse()};
  const Vector3d shift = drift(config, time_s);
  const auto box = view_box(camera, T_world_camera_start, shift, config.range_m);
  const Eigen::Vector3i low = (box.min() / kCell).array().floor().cast<int>();
  const Eigen::Vector3i high = (box.max() / kCell).array().floor().cast<int>();
  const double expected = config.density_per_m3 * kCell * kCell * kCell;
  for (int z = low.z(); z <= high.z(); ++z) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int x = low.x(); x <= high.x(); ++x) {
        const Cell cell{x, y, z};
        const std::uint32_t key = cell_key(cell, seed);
        const int count =
            static_cast<int>(expected + static_cast<double>(unit_float(hash32(key, 99))));
        for (int k = 0; k < count; ++k) {
          Particle particle =
              make_particle(config, cell, hash32(key, static_cast<std::uint32_t>(100 + k)));
          particle.position += shift;
          draw_particle(particle, config, color, camera, poses, range, linear);
        }
      }
    }
  }
}

}  // namespace apvi::sim
