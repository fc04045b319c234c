// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

#include "sim/spectral/water_optics.hpp"

namespace apvi::sim {

/// A function of a cosine or of a component of a direction, -1 to 1, tabulated.
template <int kSteps>
struct CosineTable {
  std::array<float, kSteps + 2> values{};  ///< one more, so that interpolation needs no branch

  template <typename Function>
  static CosineTable of(const Function& value) {
    CosineTable table;
    for (int i = 0; i <= kSteps; ++i)
      table.values[static_cast<std::size_t>(i)] =
          static_cast<float>(value(-1.0 + 2.0 * i / kSteps));
    table.values.back() = table.values[kSteps];
    return table;
  }
  float at(float cosine) const {
    const float x = (cosine + 1.0F) * (0.5F * kSteps);
    const float inside = x < 0.0F ? 0.0F : (x > kSteps ? kSteps : x);
    const auto k = static_cast<std::size_t>(inside);
    return values[k] + (inside - static_cast<float>(k)) * (values[k + 1] - values[k]);
  }
};
using ElevationTable = CosineTable<64>;  ///< by the vertical component of a direction

/// Angular distribution of the diffuse light under water, which is nearly the same at every depth:
/// L(w) proportional to 1 / (1 - e m)^2 with m the cosine of the angle between the direction of
/// travel and straight down. e = 0.9 gives the measured ratios of Lake Pend Oreille (Tyler, 1960):
/// zenith to horizontal 100, horizontal to nadir 3.6. Scaled to 1 downwelling irradiance.
double diffuse_radiance(double m);

/// Irradiance of that light on a surface, by the vertical component of its normal; 1 facing up.
const ElevationTable& diffuse_irradiance();
/// Light scattered out of it by more than the small angle into the direction towards the camera
/// [1/sr], by the vertical component of the direction of view; times b and the irradiance it is
/// the source of the backscatter.
const ElevationTable& diffuse_scatter();
/// The phase function by the cosine of the angle; within the small angle its value at the limit.
const CosineTable<1024>& wide_phase();

}  // namespace apvi::sim
