// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "sim/render/water.hpp"
#include "sim/spectral/spectrum.hpp"

namespace apvi::sim {

/// Inherent optical properties of a water, per band [1/m], and what follows from them.
struct WaterOptics {
  Spectrum absorption{};  ///< a
  Spectrum scattering{};  ///< b

  /// Beam attenuation c = a + b: what an unscattered ray loses.
  Spectrum beam() const;
  /// a + (1 - F) b, with the fraction F of `sharp_fraction`: what a pixel loses of its own light.
  Spectrum sharp() const;
  /// a + (1 - F) b, with the fraction F of `small_angle_fraction`: what is lost if light scattered
  /// by small angles still arrives, slightly blurred.
  Spectrum smooth() const;
  /// Diffuse attenuation of daylight (Lee, Du and Arnone, "A model for the diffuse attenuation
  /// coefficient of downwelling irradiance", JGR 110, C02016, 2005, with the sun at `zenith_deg` in
  /// air): K_d = (1 + 0.005 zenith) a + 4.18 (1 - 0.52 exp(-10.8 a)) b_b.
  Spectrum diffuse(double zenith_deg) const;
};

/// Properties of a Jerlov type. Types IB, II, III, 1C, 3C and 5C are measured (Williamson and
/// Hollins, "Measured IOPs of Jerlov water types", Applied Optics 61 (33), 2022); I, IA, 7C and 9C
/// are fitted to Jerlov's attenuation (Solonenko and Mobley, Applied Optics 54 (17), 2015).
/// `attenuation_length_m` scales what is in the water, beyond pure water, so that the beam
/// attenuation at 540 nm is its inverse; a length beyond that of pure water gives pure water.
WaterOptics make_optics(JerlovType type, std::optional<double> attenuation_length_m);

/// Beam attenuation at 540 nm [1/m].
double beam_at_green(const WaterOptics& optics);

/// Pure water: absorption as in Williamson and Hollins (2022), scattering after Haltrin (1999).
WaterOptics pure_water();

}  // namespace apvi::sim
