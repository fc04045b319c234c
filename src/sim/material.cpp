// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sim/material.hpp"

#include "material_kernels.hpp"

namespace apvi::sim {
namespace texture {

Colour pick(const Colour* palette, int count, float random) {
  const float scaled = random * static_cast<float>(count);
  const int index = static_cast<int>(scaled);
  return palette[index] * (0.85F + 0.3F * (scaled - static_cast<float>(index)));
}

void bump(SurfaceBatch& s, const Gradient& field, float height) {
  for (int i = 0; i < kBatch; ++i) {
    const float gx = field.dx.v[i] * height;
    const float gy = field.dy.v[i] * height;
    const float gz = field.dz.v[i] * height;
    const float along = gx * s.nx.v[i] + gy * s.ny.v[i] + gz * s.nz.v[i];
    const float x = s.nx.v[i] - gx + along * s.nx.v[i];
    const float y = s.ny.v[i] - gy + along * s.ny.v[i];
    const float z = s.nz.v[i] - gz + along * s.nz.v[i];
    const float scale = 1.0F / __builtin_sqrtf(x * x + y * y + z * z);
    s.nx.v[i] = x * scale;
    s.ny.v[i] = y * scale;
    s.nz.v[i] = z * scale;
  }
}

void bump_cells(SurfaceBatch& s, const Cells& field, const Lanes& cover, float frequency,
                float height, float radius) {
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init): scratch, filled before use
  Gradient dome;
  for (int i = 0; i < kBatch; ++i) {
    // height (1 - d^2 / radius^2) inside: its gradient is -2 offset / radius^2, per metre.
    const bool inside = field.nearest.v[i] < radius;
    const float slope = inside ? -2.0F * frequency * cover.v[i] / (radius * radius) : 0.0F;
    dome.dx.v[i] = slope * field.dx.v[i];
    dome.dy.v[i] = slope * field.dy.v[i];
    dome.dz.v[i] = slope * field.dz.v[i];
  }
  bump(s, dome, height);
}

}  // namespace texture

void evaluate_material(Material material, SurfaceBatch& batch) {
  switch (material) {
    case Material::plain:
      for (Lanes* lanes : {&batch.r, &batch.g, &batch.b}) lanes->fill(0.5F);
      return;
    case Material::sand:
      return texture::sand(batch);
    case Material::silt:
      return texture::silt(batch);
    case Material::rock:
      return texture::rock(batch);
    case Material::brain_coral:
      return texture::brain_coral(batch);
    case Material::branch_coral:
      return texture::branch_coral(batch);
    case Material::plate_coral:
      return texture::plate_coral(batch);
    case Material::sponge:
      return texture::sponge(batch);
    case Material::fan_coral:
      return texture::fan_coral(batch);
    case Material::weed:
      return texture::weed(batch);
    case Material::mussels:
      return texture::mussels(batch);
    case Material::steel:
      return texture::steel(batch);
    case Material::wood:
      return texture::wood(batch);
    case Material::concrete:
      return texture::concrete(batch);
  }
}

}  // namespace apvi::sim
