// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

namespace apvi::sim {

/// Disturbance at one instant; the defaults mean undisturbed.
struct Disturbance {
  std::optional<double> attenuation_length_m{};  ///< replaces that of the water [m]
  double darkness = 0.0;                         ///< scales all light by 1 - darkness; 1: blackout
  double silt = 0.0;      ///< density of a cloud of stirred-up silt; 1: hides nearly everything
  double exposure = 1.0;  ///< factor on the gain after metering; 4 saturates the image
};

}  // namespace apvi::sim
