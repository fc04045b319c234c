// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>

#include "apvi/config/fields.hpp"
#include "apvi/core/random.hpp"

namespace apvi::sim {

/// Surface waves, as their significant height and dominant period; none when the height is 0.
struct WaveConfig {
  double height_m = 0.0;
  double period_s = 6.0;
  double direction_deg = 0.0;
  double response = 0.7;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("height_m", height_m, Range{0.0, 10.0}, "significant wave height, 0 for a flat sea [m]");
    v("period_s", period_s, Range{1.0, 30.0}, "dominant period [s]");
    v("direction_deg", direction_deg, Range{-360.0, 360.0}, "where they run, from world x [deg]");
    v("response", response, Range{0.0, 1.5}, "share of the water's motion the vehicle follows");
  }
};

/// Linear deep-water waves (Airy): three components about the dominant period, whose motion and
/// pressure fade with depth as exp(-k depth).
class WaveField {
 public:
  WaveField(const WaveConfig& config, Random random, double gravity);

  bool calm() const { return calm_; }
  /// Displacement of a water particle [m] whose rest position is horizontally at `x`, `y` [m] and
  /// `depth` [m] below the mean surface, `t` [s].
  Eigen::Vector3d displacement(double x, double y, double depth, double t) const;
  /// Pressure beyond the hydrostatic one at that place, as metres of water.
  double pressure_head(double x, double y, double depth, double t) const;
  /// Slope of the surfaces of equal pressure there: d head / dx, d head / dy.
  Eigen::Vector2d slope(double x, double y, double depth, double t) const;

 private:
  struct Component {
    Eigen::Vector2d wave_vector;  // [rad/m]
    double number = 0.0;          // its norm
    double frequency = 0.0;       // [rad/s]
    double amplitude = 0.0;       // [m]
    double phase = 0.0;           // [rad]

    double angle(double x, double y, double t) const;
    double faded(double depth) const;
  };
  std::array<Component, 3> components_;
  bool calm_ = true;
};

}  // namespace apvi::sim
