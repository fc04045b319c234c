// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/lamp_light.hpp"

#include <cmath>
#include <numbers>

namespace apvi::sim {
namespace {

double gauss(double x, double center, double width) {
  const double t = (x - center) / width;
  return std::exp(-0.5 * t * t);
}

}  // namespace

LampLobe::LampLobe(const SpectralLampConfig& lamp) {
  const double half = lamp.half_beam_deg * std::numbers::pi / 180.0;
  for (int i = 0; i <= kSteps; ++i) {
    const double cosine = static_cast<double>(i) / kSteps;
    const double angle = std::acos(cosine);
    const double lobe = std::exp(-std::numbers::ln2 * std::pow(angle / half, lamp.edge));
    values_[static_cast<std::size_t>(i)] =
        static_cast<float>((lobe + lamp.spill * cosine) / (1.0 + lamp.spill));
  }
  values_.back() = values_[kSteps];
}

// A typical phosphor-converted LED of 5700 K; the widths are those of datasheets.
Spectrum led_spectrum() {
  return make_spectrum([](int k) {
    const double nm = wavelength_nm(k);
    return 0.9 * gauss(nm, 452.0, 13.0) + gauss(nm, 560.0, 58.0);
  });
}

}  // namespace apvi::sim
