// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

namespace apvi::medium {

/// A lamp on the vehicle, in the camera's frame (right, down, forward).
struct Lamp {
  std::array<double, 3> position_m{};
  std::array<double, 3> axis{0.0, 0.0, 1.0};  ///< unit vector of its beam
  double half_beam_rad = 1.0;                 ///< off-axis angle at which the intensity is halved
};

}  // namespace apvi::medium
