// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>

#include "apvi/config/fields.hpp"
#include "sim/spectral/spectrum.hpp"

namespace apvi::sim {

/// A lamp of the spectral simulation, fixed to the camera.
struct SpectralLampConfig {
  double intensity = 0.8;
  std::array<double, 3> position_m{0.25, -0.15, 0.0};
  std::array<double, 3> aim{0.0, 0.0, 1.0};
  double half_beam_deg = 60.0;
  double edge = 3.5;
  double spill = 0.02;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("intensity", intensity, Range{0.0, 100.0},
      "irradiance at 1 m on the axis without water, relative to daylight at the surface");
    v("position_m", position_m, "position in the camera frame: right, down, forward [m]");
    v("aim", aim, "direction of the axis in the camera frame: right, down, forward");
    v("half_beam_deg", half_beam_deg, Range{5.0, 89.0},
      "angle from the axis to half intensity [deg]");
    v("edge", edge, Range{1.0, 20.0}, "steepness of the edge of the beam");
    v("spill", spill, Range{0.0, 0.5}, "light outside the beam, relative to the axis");
  }
};

/// Relative intensity of a lamp by angle from its axis, tabulated: a flat lobe with an edge, and
/// spill light from its front glass,
/// exp(-ln 2 (angle / half_beam)^edge) + spill cos(angle), scaled to 1 on the axis; 0 behind.
class LampLobe {
 public:
  LampLobe() = default;
  explicit LampLobe(const SpectralLampConfig& lamp);

  float at(float cosine) const {
    const float x = cosine * kSteps;
    const int i = static_cast<int>(x < 0.0F ? 0.0F : (x > kSteps ? kSteps : x));
    const float t = x < 0.0F ? 0.0F : x - static_cast<float>(i);
    const auto k = static_cast<std::size_t>(i);
    return x < 0.0F ? 0.0F : values_[k] + t * (values_[k + 1] - values_[k]);
  }

 private:
  static constexpr int kSteps = 256;
  std::array<float, kSteps + 2> values_{};
};

/// Spectrum of a white LED (a blue line at 452 nm and its phosphor around 560 nm), relative.
Spectrum led_spectrum();

}  // namespace apvi::sim
