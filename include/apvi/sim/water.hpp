// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "apvi/config/fields.hpp"

namespace apvi::sim {

/// Jerlov's water types: I to III oceanic, 1C to 9C coastal, from clear to turbid.
enum class JerlovType { I, IA, IB, II, III, C1, C3, C5, C7, C9 };

/// Particles that drift through the view and catch the light.
struct SnowConfig {
  double density_per_m3 = 60.0;
  double size_mm = 1.2;
  double brightness = 0.5;
  double range_m = 2.5;
  std::array<double, 3> current_m_s{0.05, 0.02, -0.01};

  template <typename V>
  void visit(V& v) {
    v("density_per_m3", density_per_m3, config::Range{0.0, 5000.0}, "particles [1/m^3]");
    v("size_mm", size_mm, config::Range{0.05, 20.0}, "median diameter [mm]");
    v("brightness", brightness, config::Range{0.0, 5.0}, "albedo of a particle");
    v("range_m", range_m, config::Range{0.2, 6.0}, "particles farther away are not drawn [m]");
    v("current_m_s", current_m_s, "drift of the water, east, north, up [m/s]");
  }
};

struct WaterConfig {
  JerlovType type = JerlovType::II;
  std::optional<double> attenuation_length_m = 6.0;
  double reference_depth_m = 9.0;
  double veil = 0.35;
  double veil_gradient = 0.0;
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
      "Jerlov water type that gives the coefficients");
    v("attenuation_length_m", attenuation_length_m, config::Range{0.1, 100.0},
      "1 / beta_d of green, by more or fewer particles; null: as the type has it [m]");
    v("reference_depth_m", reference_depth_m, config::Range{0.0, 100.0},
      "depth whose daylight makes the veil's colour [m]");
    v("veil", veil, config::Range{0.0, 2.0}, "b_inf = veil * scattering albedo * daylight there");
    v("veil_gradient", veil_gradient, config::Range{0.0, 0.9},
      "brightening of the veil towards the surface; 0: constant, as in the paper");
    v("beta_d", beta_d, config::Range{0.0, 50.0}, "instead of the type's, red green blue [1/m]");
    v("beta_b", beta_b, config::Range{0.0, 50.0}, "instead of the type's, red green blue [1/m]");
    v("b_inf", b_inf, config::Range{0.0, 4.0}, "instead of the type's, red green blue, gain 1");
    v("snow", snow, "marine snow");
  }
};

/// Coefficients of the image formation model, red, green, blue:
/// I = J exp(-beta_d r) + b_inf (1 - exp(-beta_b r)), r the range along the ray [m] (Akkaynak and
/// Treibitz, "A revised underwater image formation model", CVPR 2018).
struct Medium {
  Eigen::Vector3d beta_d = Eigen::Vector3d::Zero();  ///< attenuation of the direct signal [1/m]
  Eigen::Vector3d beta_b = Eigen::Vector3d::Zero();  ///< growth of the veil [1/m]
  Eigen::Vector3d b_inf = Eigen::Vector3d::Zero();   ///< the veil at infinity, daylight at z=0 is 1
  Eigen::Vector3d k_d = Eigen::Vector3d::Zero();     ///< loss of daylight with depth [1/m]
};

/// The medium of a configuration; `attenuation_length_m` (a visibility event) overrides the
/// configured one and every explicit beta, keeping their colour.
Medium make_medium(const WaterConfig& config,
                   std::optional<double> attenuation_length_m = std::nullopt);

/// The formula above for one ray.
Eigen::Vector3d apply_medium(const Medium& medium, const Eigen::Vector3d& clear, double range);

}  // namespace apvi::sim
