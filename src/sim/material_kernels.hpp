// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/sim/material.hpp"

/// Pieces that the solid textures are put together from.
namespace apvi::sim::texture {

using sim::mix;

struct Colour {
  float r, g, b;
};

inline Colour mix(const Colour& a, const Colour& b, float t) {
  return {sim::mix(a.r, b.r, t), sim::mix(a.g, b.g, t), sim::mix(a.b, b.b, t)};
}
inline Colour operator*(const Colour& c, float factor) {
  return {c.r * factor, c.g * factor, c.b * factor};
}
inline float magnitude(float x) {
  return x < 0.0F ? -x : x;
}
inline float clamp01(float x) {
  return x < 0.0F ? 0.0F : (x > 1.0F ? 1.0F : x);
}

inline void put(SurfaceBatch& s, int i, const Colour& c) {
  s.r.v[i] = clamp01(c.r);
  s.g.v[i] = clamp01(c.g);
  s.b.v[i] = clamp01(c.b);
}

/// Variance of a normal's z about its mean, from how much shorter than 1 that is.
inline float tilt_variance(const SurfaceBatch& s, int i) {
  const float length2 = s.nx.v[i] * s.nx.v[i] + s.ny.v[i] * s.ny.v[i] + s.nz.v[i] * s.nz.v[i];
  const float slope2 = 1.0F / length2 - 1.0F;
  return 0.25F * slope2 * slope2 + 0.5F * slope2 * (length2 - s.nz.v[i] * s.nz.v[i]);
}

/// One of `count` colours by the thing's random number, shaded a little by the rest of it.
Colour pick(const Colour* palette, int count, float random);
/// Turns the normals as if the surface were raised by height * value [m]. What is too fine to be
/// seen shortens them to the mean of those it has, so that light on it is as bright from far as
/// from near (Toksvig, "Mipmapping normal maps", 2005; exact for a matt surface).
void bump(SurfaceBatch& s, const Gradient& field, float height);

/// Something on every cell (barnacles, polyps, mussels): height (1 - d^2 / radius^2) inside.
struct Dome {
  float height;    ///< [m]
  float radius;    ///< [cells]
  float slope;     ///< gradient of height 1 for an offset of a cell [1/m]
  float variance;  ///< of that along an axis [1/m^2]
};
/// `frequency` of the cells [1/m].
Dome make_dome(float frequency, float height, float radius);
/// Raises it times `cover`.
void bump_cells(SurfaceBatch& s, const Cells& field, const Lanes& cover, const Dome& dome);

/// What cells of frequency 1 are at a place, and an octave of noise.
struct Place {
  float nearest, border, id, wave;
};
/// Places spread over many cells and waves.
const std::vector<Place>& typical_places();
/// What a texture makes of them in the mean: what is seen of it from too far to tell them apart.
template <typename Quantity>
float mean_over_places(const Quantity& of) {
  double sum = 0.0;
  for (const Place& place : typical_places()) sum += static_cast<double>(of(place));
  return static_cast<float>(sum / static_cast<double>(typical_places().size()));
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
/// Mussels in beds on top of what `s` holds; the dam's face stands out where they are.
void add_mussel_beds(SurfaceBatch& s);
void steel(SurfaceBatch& s);
void wood(SurfaceBatch& s);
void concrete(SurfaceBatch& s);

}  // namespace apvi::sim::texture
