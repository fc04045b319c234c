// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "sim/world/material.hpp"

/// Building blocks of the solid textures.
namespace apvi::sim::texture {

using sim::mix;

struct Color {
  float r, g, b;
};

inline Color mix(const Color& a, const Color& b, float t) {
  return {sim::mix(a.r, b.r, t), sim::mix(a.g, b.g, t), sim::mix(a.b, b.b, t)};
}
inline Color operator*(const Color& c, float factor) {
  return {c.r * factor, c.g * factor, c.b * factor};
}
inline float magnitude(float x) {
  return x < 0.0F ? -x : x;
}
inline float clamp01(float x) {
  return x < 0.0F ? 0.0F : (x > 1.0F ? 1.0F : x);
}

inline void set_color(SurfaceBatch& s, int i, const Color& c) {
  s.r.v[i] = clamp01(c.r);
  s.g.v[i] = clamp01(c.g);
  s.b.v[i] = clamp01(c.b);
}

/// Variance of the z component of the normals that were averaged, from the length of their mean.
inline float tilt_variance(const SurfaceBatch& s, int i) {
  const float length2 = s.nx.v[i] * s.nx.v[i] + s.ny.v[i] * s.ny.v[i] + s.nz.v[i] * s.nz.v[i];
  const float slope2 = 1.0F / length2 - 1.0F;
  return 0.25F * slope2 * slope2 + 0.5F * slope2 * (length2 - s.nz.v[i] * s.nz.v[i]);
}

/// One of `count` colors selected by the object's random number, with slightly varied brightness.
Color pick(const Color* palette, int count, float random);
/// Perturbs the normals as if the surface were displaced by height * value [m]. Filtered-out bumps
/// shorten the normals to the mean normal, so that the mean brightness does not depend on distance
/// (Toksvig, "Mipmapping normal maps", 2005; exact for a matte surface).
void bump(SurfaceBatch& s, const Gradient& field, float height);

/// A bump in every cell (barnacles, polyps, mussels): height (1 - d^2 / radius^2) inside.
struct Dome {
  float height;    ///< [m]
  float radius;    ///< [cells]
  float slope;     ///< gradient for height 1 at an offset of one cell [1/m]
  float variance;  ///< of the gradient along an axis [1/m^2]
};
/// `frequency` of the cells [1/m].
Dome make_dome(float frequency, float height, float radius);
/// Adds the bump to every cell, scaled by `cover`.
void bump_cells(SurfaceBatch& s, const Cells& field, const Lanes& cover, const Dome& dome);

/// Cellular noise of frequency 1 and one octave of gradient noise at one point.
struct TextureSample {
  float nearest, border, id, wave;
};
/// Samples distributed over many cells and wavelengths.
const std::vector<TextureSample>& texture_samples();
/// Mean of a texture function over the samples: its value when filtered out by a large footprint.
template <typename Quantity>
float texture_mean(const Quantity& of) {
  double sum = 0.0;
  for (const TextureSample& place : texture_samples()) sum += static_cast<double>(of(place));
  return static_cast<float>(sum / static_cast<double>(texture_samples().size()));
}

void sand(SurfaceBatch& s);
void silt(SurfaceBatch& s);
void rock(SurfaceBatch& s);
void brain_coral(SurfaceBatch& s);
void branch_coral(SurfaceBatch& s);
void plate_coral(SurfaceBatch& s);
void sponge(SurfaceBatch& s);
void fan_coral(SurfaceBatch& s);
void weed(SurfaceBatch& s);
void mussels(SurfaceBatch& s);
void fish(SurfaceBatch& s);
/// Blends mussel beds over `s`; the dam's face is raised at the same places.
void add_mussel_beds(SurfaceBatch& s);
void steel(SurfaceBatch& s);
void wood(SurfaceBatch& s);
void concrete(SurfaceBatch& s);

}  // namespace apvi::sim::texture
