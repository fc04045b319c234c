// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace apvi::sim {

/// What a triangle is made of; the renderer evaluates its solid texture per pixel.
enum class Material : std::uint8_t {
  plain,  ///< albedo 0.5 in every channel, no texture, no bumps: for tests and calibration
  sand,
  silt,  ///< featureless mud
  rock,
  brain_coral,
  branch_coral,
  plate_coral,
  sponge,
  fan_coral,
  weed,
  steel,  ///< hull plates: paint, rust, growth
  wood,
  concrete,
  mussels,
};
inline constexpr int kMaterialCount = 14;

}  // namespace apvi::sim
