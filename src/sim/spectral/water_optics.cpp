// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/water_optics.hpp"

#include <algorithm>
#include <cmath>

#include "sim/spectral/phase_function.hpp"

namespace apvi::sim {
namespace {

constexpr std::size_t kGreenBand = 7;  // 540 nm

// Williamson and Hollins (2022), Crown copyright, OGL v3.0; I, IA, 7C, 9C:
// Solonenko and Mobley (2015), linear between their wavelengths.
const WaterOptics kTypes[] = {
    // I
    {{0.022, 0.018, 0.0176, 0.0184, 0.0204, 0.026, 0.042, 0.0556, 0.07, 0.111, 0.228, 0.282, 0.318,
      0.374, 0.464, 0.582},
     {0.0062, 0.0051, 0.00421, 0.00351, 0.00295, 0.00249, 0.00214, 0.00184, 0.00159, 0.00139,
      0.00122, 0.00108, 0.000955, 0.000852, 0.000763, 0.000685}},
    // IA
    {{0.0295, 0.0239, 0.0223, 0.0219, 0.0229, 0.0282, 0.0431, 0.056, 0.0702, 0.111, 0.228, 0.282,
      0.318, 0.374, 0.464, 0.582},
     {0.0092, 0.00788, 0.00681, 0.00593, 0.00521, 0.00461, 0.00414, 0.00373, 0.00338, 0.00309,
      0.00283, 0.00261, 0.00243, 0.00226, 0.00211, 0.00198}},
    // IB
    {{0.0448, 0.043, 0.0423, 0.039, 0.037, 0.0398, 0.0515, 0.0572, 0.073, 0.1, 0.227, 0.285, 0.314,
      0.383, 0.436, 0.573},
     {0.144, 0.14, 0.136, 0.133, 0.13, 0.128, 0.125, 0.123, 0.121, 0.12, 0.118, 0.116, 0.115, 0.113,
      0.112, 0.111}},
    // II
    {{0.0745, 0.0697, 0.066, 0.0588, 0.0534, 0.0529, 0.0615, 0.065, 0.0792, 0.105, 0.231, 0.288,
      0.318, 0.386, 0.44, 0.575},
     {0.209, 0.203, 0.198, 0.193, 0.189, 0.185, 0.181, 0.178, 0.175, 0.172, 0.17, 0.167, 0.165,
      0.163, 0.161, 0.159}},
    // III
    {{0.13, 0.127, 0.121, 0.104, 0.0911, 0.0835, 0.0841, 0.0825, 0.0922, 0.116, 0.241, 0.3, 0.33,
      0.402, 0.462, 0.581},
     {0.324, 0.318, 0.312, 0.307, 0.302, 0.297, 0.293, 0.289, 0.285, 0.281, 0.278, 0.275, 0.272,
      0.269, 0.267, 0.264}},
    // 1C
    {{0.186, 0.176, 0.163, 0.137, 0.116, 0.104, 0.1, 0.0952, 0.101, 0.124, 0.248, 0.307, 0.338,
      0.413, 0.477, 0.585},
     {0.474, 0.466, 0.459, 0.452, 0.446, 0.44, 0.435, 0.429, 0.425, 0.42, 0.416, 0.411, 0.407,
      0.404, 0.4, 0.396}},
    // 3C
    {{0.236, 0.233, 0.22, 0.186, 0.16, 0.144, 0.136, 0.127, 0.127, 0.146, 0.268, 0.328, 0.358,
      0.437, 0.508, 0.598},
     {0.713, 0.702, 0.691, 0.681, 0.672, 0.664, 0.656, 0.648, 0.641, 0.634, 0.627, 0.621, 0.615,
      0.609, 0.604, 0.599}},
    // 5C
    {{0.469, 0.414, 0.359, 0.283, 0.23, 0.199, 0.18, 0.163, 0.152, 0.166, 0.285, 0.349, 0.382, 0.47,
      0.558, 0.614},
     {1.32, 1.3, 1.28, 1.26, 1.24, 1.23, 1.21, 1.2, 1.19, 1.17, 1.16, 1.15, 1.14, 1.13, 1.12,
      1.11}},
    // 7C
    {{1.03, 0.808, 0.626, 0.48, 0.368, 0.29, 0.244, 0.21, 0.187, 0.2, 0.301, 0.354, 0.389, 0.465,
      0.571, 0.621},
     {4.02, 3.71, 3.43, 3.18, 2.96, 2.76, 2.58, 2.43, 2.28, 2.15, 2.03, 1.92, 1.82, 1.73, 1.64,
      1.56}},
    // 9C
    {{1.61, 1.32, 1.06, 0.849, 0.676, 0.543, 0.453, 0.381, 0.325, 0.311, 0.39, 0.427, 0.448, 0.515,
      0.613, 0.651},
     {5.36, 4.94, 4.57, 4.24, 3.94, 3.67, 3.44, 3.22, 3.03, 2.85, 2.69, 2.55, 2.41, 2.29, 2.17,
      2.07}},
};

constexpr Spectrum kPureAbsorption{0.0058, 0.0079, 0.0104, 0.0124, 0.0152, 0.0238, 0.0409, 0.0495,
                                   0.0672, 0.0952, 0.2224, 0.281,  0.3111, 0.3791, 0.4318, 0.5722};

Spectrum blend(const Spectrum& pure, const Spectrum& typed, double amount) {
  Spectrum out{};
  for (std::size_t k = 0; k < kBands; ++k)
    out[k] = pure[k] + amount * std::max(0.0, typed[k] - pure[k]);
  return out;
}

// Attenuation of light of which that fraction of the scattering is no loss.
Spectrum lost(const WaterOptics& water, double kept) {
  return make_spectrum([&](int k) {
    const auto i = static_cast<std::size_t>(k);
    return water.absorption[i] + (1.0 - kept) * water.scattering[i];
  });
}

}  // namespace

Spectrum WaterOptics::beam() const {
  return lost(*this, 0.0);
}

Spectrum WaterOptics::sharp() const {
  return lost(*this, sharp_fraction());
}

Spectrum WaterOptics::smooth() const {
  return lost(*this, small_angle_fraction());
}

Spectrum WaterOptics::diffuse(double zenith_deg) const {
  const double backward = FournierForand().backscatter_fraction();
  return make_spectrum([&](int k) {
    const double a = absorption[static_cast<std::size_t>(k)];
    const double b = backward * scattering[static_cast<std::size_t>(k)];
    return (1.0 + 0.005 * zenith_deg) * a + 4.18 * (1.0 - 0.52 * std::exp(-10.8 * a)) * b;
  });
}

double beam_at_green(const WaterOptics& optics) {
  return optics.beam()[kGreenBand];
}

WaterOptics pure_water() {
  return {.absorption = kPureAbsorption, .scattering = make_spectrum([](int k) {
                                           return 0.005826 *
                                                  std::pow(400.0 / wavelength_nm(k), 4.322);
                                         })};
}

WaterOptics make_optics(JerlovType type, std::optional<double> attenuation_length_m) {
  const WaterOptics& typed = kTypes[static_cast<int>(type)];
  if (!attenuation_length_m) return typed;
  const WaterOptics pure = pure_water();
  const double own = beam_at_green(pure);
  const double amount = (1.0 / *attenuation_length_m - own) / (beam_at_green(typed) - own);
  return {.absorption = blend(pure.absorption, typed.absorption, std::max(0.0, amount)),
          .scattering = blend(pure.scattering, typed.scattering, std::max(0.0, amount))};
}

}  // namespace apvi::sim
