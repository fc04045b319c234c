// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "sim/world/noise_texture.hpp"

namespace apvi::sim {

/// Material of a triangle; the renderer evaluates its solid texture per pixel.
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
  fish,  ///< in the texture coordinates of a fish
};
inline constexpr int kMaterialCount = 15;

/// Points on surfaces of one material. `evaluate_material` fills the color and perturbs the normals
/// by the bump map of the texture. Lanes stay uninitialized: clearing ten of them for every batch
/// would cost as much as evaluating a material.
struct SurfaceBatch {  // NOLINT(cppcoreguidelines-pro-type-member-init)
  Points p;            ///< world [m]
  Lanes nx, ny, nz;    ///< unit normal, toward the camera; evaluated: the mean of a pixel's normals
  Lanes detail;        ///< of the mesh: see there
  Lanes object;        ///< random in [0, 1), the same over a thing
  Lanes r, g, b;       ///< albedo, filled
};
void evaluate_material(Material material, SurfaceBatch& batch);

/// A vertical cylinder in whose inside an albedo is mixed into that of every surface.
struct Tint {
  float x, y;     ///< of the axis [m]
  float radius;   ///< [m]; the mixing fades in the outer fifth
  float r, g, b;  ///< albedo
  float amount;   ///< its part, 0 to 1
};
void apply_tints(const std::vector<Tint>& tints, SurfaceBatch& batch);

}  // namespace apvi::sim
