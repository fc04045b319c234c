// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/light.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace apvi::sim {

using Eigen::Vector3d;

Vector3d daylight_at(const LightConfig& config, const Medium& medium, double depth_m) {
  return config.daylight * (-medium.k_d * std::max(0.0, depth_m)).array().exp();
}

double lamp_beam(const LampConfig& lamp, double cos_angle) {
  if (cos_angle <= 0.0) return 0.0;
  const double half = std::cos(lamp.half_beam_deg * std::numbers::pi / 180.0);
  return std::exp(-std::numbers::ln2 * (1.0 - cos_angle) / (1.0 - half));
}

Vector3d lamp_irradiance(const LampConfig& lamp, const Medium& medium, const Vector3d& p,
                         const Vector3d& normal) {
  const Vector3d position(lamp.position_m[0], lamp.position_m[1], lamp.position_m[2]);
  const Vector3d ray = p - position;
  const double distance = std::max(0.05, ray.norm());
  const Vector3d direction = ray / distance;
  const double incidence = std::max(0.0, -normal.dot(direction));
  const double geometry =
      lamp.intensity * lamp_beam(lamp, direction.z()) * incidence / (distance * distance);
  const Vector3d color(lamp.color[0], lamp.color[1], lamp.color[2]);
  const Vector3d water = (-medium.beta_d * distance).array().exp();
  return geometry * color.cwiseProduct(water);
}

Vector3d scene_white_balance(const LightConfig& config, const Medium& medium, double depth_m) {
  const Vector3d p(0.0, 0.0, 1.5);
  Vector3d light = daylight_at(config, medium, depth_m);
  if (config.lamp) light += lamp_irradiance(*config.lamp, medium, p, -Vector3d::UnitZ());
  light = light.cwiseProduct(Vector3d((-medium.beta_d * p.z()).array().exp()));
  const Vector3d dimmest = Vector3d::Constant(1e-3 * std::max(1e-9, light.y()));
  return (light.y() / light.cwiseMax(dimmest).array()).pow(0.65);
}

Vector3d sun_direction(const LightConfig& config) {
  const double elevation = config.sun_elevation_deg * std::numbers::pi / 180.0;
  const double azimuth = config.sun_azimuth_deg * std::numbers::pi / 180.0;
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

}  // namespace apvi::sim
