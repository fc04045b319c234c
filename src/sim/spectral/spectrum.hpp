// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>

namespace apvi::sim {

/// Number of spectral bands: 20 nm wide, centered on 400, 420, ... 700 nm.
inline constexpr int kBands = 16;
/// One value per band.
using Spectrum = std::array<double, kBands>;
using SpectrumF = std::array<float, kBands>;

/// Center of a band [nm].
constexpr double wavelength_nm(int band) {
  return 400.0 + 20.0 * band;
}

/// A spectrum computed band by band from a function of the band's number.
template <typename Function>
Spectrum make_spectrum(const Function& value) {
  Spectrum spectrum{};
  for (int k = 0; k < kBands; ++k) spectrum[static_cast<std::size_t>(k)] = value(k);
  return spectrum;
}

inline SpectrumF to_float(const Spectrum& spectrum) {
  SpectrumF out{};
  for (std::size_t k = 0; k < kBands; ++k) out[k] = static_cast<float>(spectrum[k]);
  return out;
}

/// CIE standard illuminant D65, relative power (ISO/CIE 11664-2), every 20 nm: daylight at the
/// surface, sun and sky together.
inline constexpr Spectrum kDaylightD65{82.75, 93.43, 104.87, 117.81, 115.92, 109.35, 104.79, 104.41,
                                       100.0, 95.79, 90.01,  87.70,  83.70,  80.21,  78.28,  71.61};

}  // namespace apvi::sim
