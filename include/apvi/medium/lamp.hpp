// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>

namespace apvi::medium {

inline constexpr std::size_t kMaxLamps = 4;

/// A lamp on the vehicle, in the camera's frame (right, down, forward).
struct Lamp {
  std::array<double, 3> position_m{};
  std::array<double, 3> axis{0.0, 0.0, 1.0};  ///< unit vector of its beam
  double half_beam_rad = 1.0;                 ///< off-axis angle at which the intensity is halved
  double edge = 0.0;   ///< 0: the beam falls off like a bell; 1: it is flat with a steep edge
  double share = 1.0;  ///< of the light of all lamps, on their axes at one distance
};

}  // namespace apvi::medium
