// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "apvi/config/fields.hpp"
#include "sim/render/water.hpp"

namespace apvi::sim {

/// A lamp on the vehicle, fixed to the camera.
struct LampConfig {
  double intensity = 0.8;
  std::array<double, 3> color{1.0, 0.96, 0.9};
  std::array<double, 3> position_m{0.25, -0.15, 0.0};
  double half_beam_deg = 60.0;
  double backscatter = 0.25;

  template <typename V>
  void visit(V& v) {
    v("intensity", intensity, config::Range{0.0, 100.0},
      "irradiance at 1 m on the axis without water, relative to daylight at the surface");
    v("color", color, config::Range{0.0, 2.0}, "red, green, blue");
    v("position_m", position_m, "position in the camera frame: right, down, forward [m]");
    v("half_beam_deg", half_beam_deg, config::Range{5.0, 89.0},
      "angle from the axis to half intensity [deg]");
    v("backscatter", backscatter, config::Range{0.0, 5.0},
      "lamp light that the water scatters back into the camera; 0: none, as in the paper");
  }
};

struct LightConfig {
  double daylight = 1.0;
  double direct_fraction = 0.35;
  double sun_elevation_deg = 60.0;
  double sun_azimuth_deg = 40.0;
  double caustics = 0.0;
  double caustic_scale_m = 0.6;
  std::optional<LampConfig> lamp{};

  template <typename V>
  void visit(V& v) {
    v("daylight", daylight, config::Range{0.0, 100.0}, "irradiance just below the surface");
    v("direct_fraction", direct_fraction, config::Range{0.0, 1.0},
      "fraction of the daylight that is direct and casts shading; the rest is diffuse");
    v("sun_elevation_deg", sun_elevation_deg, config::Range{45.0, 90.0},
      "elevation of the refracted sun under water [deg]");
    v("sun_azimuth_deg", sun_azimuth_deg, config::Range{-360.0, 360.0},
      "azimuth of the sun, from east to north [deg]");
    v("caustics", caustics, config::Range{0.0, 2.0}, "contrast of moving caustics; 0: none");
    v("caustic_scale_m", caustic_scale_m, config::Range{0.05, 10.0},
      "cell size of the caustic pattern [m]");
    v("lamp", lamp, "lamp on the vehicle; null: none");
  }
};

/// Daylight irradiance on a horizontal plane at a depth: daylight exp(-k_d depth).
Eigen::Vector3d daylight_at(const LightConfig& config, const Medium& medium, double depth_m);
/// Relative intensity of the lamp at an angle from its axis: 1 on the axis, 0.5 at half_beam_deg, 0
/// behind the lamp: exp(-ln 2 (1 - cos) / (1 - cos half_beam_deg)).
double lamp_beam(const LampConfig& lamp, double cos_angle);
/// Irradiance of the lamp on a surface at `p` with unit `normal`, both in the camera frame:
/// intensity * beam(angle) * cos(incidence) / d^2 * exp(-beta_d d), d the distance to the lamp.
Eigen::Vector3d lamp_irradiance(const LampConfig& lamp, const Medium& medium,
                                const Eigen::Vector3d& p, const Eigen::Vector3d& normal);
/// White-balance factors of red, green, blue (green 1) for this scene: the inverse of the light
/// that arrives from a surface 1.5 m in front of the camera at `depth_m`, to the power 0.65, since
/// real cameras do not correct the color cast fully either.
Eigen::Vector3d scene_white_balance(const LightConfig& config, const Medium& medium,
                                    double depth_m);
/// Unit vector toward the refracted sun, in the world frame.
Eigen::Vector3d sun_direction(const LightConfig& config);

}  // namespace apvi::sim
