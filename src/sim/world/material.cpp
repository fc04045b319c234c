// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/material.hpp"

#include <cmath>
#include <memory>

#include "sim/world/material_kernels.hpp"

namespace apvi::sim {
namespace texture {
namespace {

// For normally distributed slopes of variance v (sum of both axes), the mean normal has the length
// 1 / sqrt(1 + shortening(v)): 1 - v / 2 + 3 v^2 / 4 - ...
constexpr float kSpread = 0.75F;
float shortening(float variance) {
  return variance / (1.0F + kSpread * variance);
}

}  // namespace

Color pick(const Color* palette, int count, float random) {
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
    const float lost_variance = shortening(2.0F * height * height * field.lost_variance.v[i]);
    const float scale = 1.0F / __builtin_sqrtf(x * x + y * y + z * z + lost_variance);
    s.nx.v[i] = x * scale;
    s.ny.v[i] = y * scale;
    s.nz.v[i] = z * scale;
  }
}

const std::vector<TextureSample>& texture_samples() {
  static const std::vector<TextureSample> places = [] {
    constexpr int kBatches = 64;
    constexpr float kSampleSpacing = 0.618F;  // [cells]: irrational, so every sample differs
    std::vector<TextureSample> all;
    auto p = std::make_unique<Points>();
    auto field = std::make_unique<Cells>();
    auto waves = std::make_unique<Lanes>();
    p->count = kBatch;
    p->footprint.fill(0.0F);
    for (int k = 0; k < kBatches; ++k) {
      for (int i = 0; i < kBatch; ++i) {
        p->x[i] = kSampleSpacing * static_cast<float>(i);
        p->y[i] = kSampleSpacing * static_cast<float>(k);
        p->z[i] = kSampleSpacing * kSampleSpacing * static_cast<float>(i + k);
      }
      cells(*p, 1.0F, 701, *field);
      fbm(*p, {.frequency = 1.0F, .octaves = 1, .gain = 1.0F, .seed = 702}, *waves);
      for (int i = 0; i < kBatch; ++i) {
        all.push_back({field->nearest[i], field->border[i], field->id[i], (*waves)[i]});
      }
    }
    return all;
  }();
  return places;
}

Dome make_dome(float frequency, float height, float radius) {
  const float slope = -2.0F * frequency / (radius * radius);
  const float length = texture_mean([&](const TextureSample& c) {
    const float steep = c.nearest < radius ? height * slope * c.nearest : 0.0F;
    return 1.0F / std::sqrt(1.0F + steep * steep * 2.0F / 3.0F);  // two of three directions
  });
  const float shorter = 1.0F / (length * length) - 1.0F;
  const float variance = shorter / (1.0F - kSpread * shorter);  // shortening(variance) is shorter
  return {height, radius, slope, 0.5F * variance / (height * height)};
}

void bump_cells(SurfaceBatch& s, const Cells& field, const Lanes& cover, const Dome& dome) {
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init): scratch, filled before use
  Gradient raised;
  for (int i = 0; i < kBatch; ++i) {
    const float seen = field.weight.v[i];
    const bool inside = field.nearest.v[i] < dome.radius;
    const float slope = inside ? dome.slope * cover.v[i] * seen : 0.0F;
    raised.dx.v[i] = slope * field.dx.v[i];
    raised.dy.v[i] = slope * field.dy.v[i];
    raised.dz.v[i] = slope * field.dz.v[i];
    raised.lost_variance.v[i] = (1.0F - seen * seen) * cover.v[i] * cover.v[i] * dome.variance;
  }
  bump(s, raised, dome.height);
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
    case Material::fish:
      return texture::fish(batch);
  }
}

void apply_tints(const std::vector<Tint>& tints, SurfaceBatch& batch) {
  for (const Tint& tint : tints) {
    for (int i = 0; i < kBatch; ++i) {
      const float dx = batch.p.x[i] - tint.x;
      const float dy = batch.p.y[i] - tint.y;
      const float distance = std::sqrt(dx * dx + dy * dy);
      const float part = tint.amount * smooth_step(tint.radius, 0.8F * tint.radius, distance);
      batch.r[i] = mix(batch.r[i], tint.r, part);
      batch.g[i] = mix(batch.g[i], tint.g, part);
      batch.b[i] = mix(batch.b[i], tint.b, part);
    }
  }
}

}  // namespace apvi::sim
