// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

/// One of `count` colours by the thing's random number, shaded a little by the rest of it.
Colour pick(const Colour* palette, int count, float random);
/// Turns the normals as if the surface were raised by height * value [m].
void bump(SurfaceBatch& s, const Gradient& field, float height);
/// Raises a dome of `height` m times `cover` on every cell (barnacles, polyps, mussels).
void bump_cells(SurfaceBatch& s, const Cells& field, const Lanes& cover, float frequency,
                float height, float radius);

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
