// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>

#include "apvi/config/fields.hpp"
#include "core/random.hpp"

namespace apvi::sim {

/// Surface waves by significant height and dominant period; no waves when the height is 0.
struct WaveConfig {
  double height_m = 0.0;
  double period_s = 6.0;
  double direction_deg = 0.0;
  double response = 0.7;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("height_m", height_m, Range{0.0, 10.0}, "significant wave height; 0: flat sea [m]");
    v("period_s", period_s, Range{1.0, 30.0}, "dominant period [s]");
    v("direction_deg", direction_deg, Range{-360.0, 360.0},
      "propagation direction, from world x [deg]");
    v("response", response, Range{0.0, 1.5},
      "fraction of the water's motion that the vehicle follows");
  }
};

/// Linear deep-water waves (Airy theory): three components around the dominant period, whose motion
/// and pressure decay with depth as exp(-k depth).
class WaveField {
 public:
  WaveField(const WaveConfig& config, Random random, double gravity);

  bool calm() const { return calm_; }
  /// Displacement [m] at time `t` [s] of a water particle with the rest position `x`, `y` [m] and
  /// `depth` [m] below the mean surface.
  Eigen::Vector3d displacement(double x, double y, double depth, double t) const;
  /// Deviation from hydrostatic pressure at that position, as meters of water.
  double pressure_head(double x, double y, double depth, double t) const;
  /// Slope of the isobars at that position: d head / dx, d head / dy.
  Eigen::Vector2d slope(double x, double y, double depth, double t) const;

 private:
  struct Component {
    Eigen::Vector2d wave_vector;  // [rad/m]
    double wave_number = 0.0;     // norm of wave_vector
    double frequency = 0.0;       // [rad/s]
    double amplitude = 0.0;       // [m]
    double phase = 0.0;           // [rad]

    double angle(double x, double y, double t) const;
    double amplitude_at(double depth) const;
  };
  std::array<Component, 3> components_;
  bool calm_ = true;
};

}  // namespace apvi::sim
