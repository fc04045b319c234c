// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "apvi/config/fields.hpp"

namespace apvi::sim {

/// Jerlov's water types: I to III oceanic, 1C to 9C coastal, from clear to turbid.
enum class JerlovType { I, IA, IB, II, III, C1, C3, C5, C7, C9 };

/// Suspended particles that reflect light (marine snow).
struct SnowConfig {
  double density_per_m3 = 60.0;
  double size_mm = 1.2;
  double brightness = 0.5;
  double range_m = 2.5;
  std::array<double, 3> current_m_s{0.05, 0.02, -0.01};

  template <typename V>
  void visit(V& v) {
    v("density_per_m3", density_per_m3, config::Range{0.0, 5000.0}, "particle density [1/m³]");
    v("size_mm", size_mm, config::Range{0.05, 20.0}, "median diameter [mm]");
    v("brightness", brightness, config::Range{0.0, 5.0}, "albedo of a particle");
    v("range_m", range_m, config::Range{0.2, 6.0}, "particles farther away are not rendered [m]");
    v("current_m_s", current_m_s, "velocity of the water: east, north, up [m/s]");
  }
};

struct WaterConfig {
  JerlovType type = JerlovType::II;
  std::optional<double> attenuation_length_m = 6.0;
  double reference_depth_m = 9.0;
  double veiling_light = 0.35;
  double veiling_light_gradient = 0.0;
  std::optional<std::array<double, 3>> beta_d{};
  std::optional<std::array<double, 3>> beta_b{};
  std::optional<std::array<double, 3>> b_inf{};
  SnowConfig snow{};

  template <typename V>
  void visit(V& v) {
    v("type", type,
      config::Choices<JerlovType>{{"I", JerlovType::I},
                                  {"IA", JerlovType::IA},
                                  {"IB", JerlovType::IB},
                                  {"II", JerlovType::II},
                                  {"III", JerlovType::III},
                                  {"1C", JerlovType::C1},
                                  {"3C", JerlovType::C3},
                                  {"5C", JerlovType::C5},
                                  {"7C", JerlovType::C7},
                                  {"9C", JerlovType::C9}},
      "Jerlov water type, which gives the coefficients");
    v("attenuation_length_m", attenuation_length_m, config::Range{0.1, 100.0},
      "1 / beta_d of green, by scaling the particle concentration; null: as of the type [m]");
    v("reference_depth_m", reference_depth_m, config::Range{0.0, 100.0},
      "depth whose daylight gives the color of the veiling light [m]");
    v("veiling_light", veiling_light, config::Range{0.0, 2.0},
      "brightness of the veiling light: b_inf = veiling_light * scattering albedo * daylight at "
      "reference_depth_m");
    v("veiling_light_gradient", veiling_light_gradient, config::Range{0.0, 0.9},
      "brightening of the veiling light toward the surface; 0: constant, as in the paper");
    v("beta_d", beta_d, config::Range{0.0, 50.0},
      "attenuation coefficients that replace the type's: red, green, blue [1/m]");
    v("beta_b", beta_b, config::Range{0.0, 50.0},
      "backscatter coefficients that replace the type's: red, green, blue [1/m]");
    v("b_inf", b_inf, config::Range{0.0, 4.0},
      "veiling light that replaces the type's: red, green, blue, at gain 1");
    v("snow", snow, "marine snow");
  }
};

/// Coefficients of the image formation model, red, green, blue:
/// I = J exp(-beta_d r) + b_inf (1 - exp(-beta_b r)), r the range along the ray [m] (Akkaynak and
/// Treibitz, "A revised underwater image formation model", CVPR 2018).
struct Medium {
  Eigen::Vector3d beta_d = Eigen::Vector3d::Zero();  ///< attenuation of the direct signal [1/m]
  Eigen::Vector3d beta_b = Eigen::Vector3d::Zero();  ///< backscatter coefficient [1/m]
  Eigen::Vector3d b_inf = Eigen::Vector3d::Zero();   ///< veiling light, daylight at z = 0 is 1
  Eigen::Vector3d k_d = Eigen::Vector3d::Zero();     ///< diffuse attenuation of daylight [1/m]
};

/// Medium of a configuration; `attenuation_length_m` (a visibility event) overrides the configured
/// one and scales explicit betas, keeping the ratios of their channels.
Medium make_medium(const WaterConfig& config,
                   std::optional<double> attenuation_length_m = std::nullopt);

/// Applies the image formation model to one ray.
Eigen::Vector3d apply_medium(const Medium& medium, const Eigen::Vector3d& clear, double range);

}  // namespace apvi::sim
