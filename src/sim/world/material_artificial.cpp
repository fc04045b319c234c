// SPDX-License-Identifier: BSD-3-Clause
// Steel, wood and concrete with fouling. `detail` is 0 at seams and edges, 1 elsewhere.
#include "sim/world/material_kernels.hpp"

// Lanes are scratch, filled before use: clearing them would cost as much as a material.
// NOLINTBEGIN(cppcoreguidelines-pro-type-member-init)

namespace apvi::sim::texture {
namespace {

// Fouling of artificial surfaces: barnacle colonies and algal turf.
struct Fouling {
  Lanes colony, turf;
  Cells barnacles;
  Lanes cover;  ///< barnacle cover fraction
};

float single_barnacle(float nearest, float id) {
  const float radius = 0.25F + 0.2F * id;
  return smooth_step(radius, 0.75F * radius, nearest);
}

// Where single shells are below the footprint, their mean cover is used.
float barnacle_cover(const Fouling& f, int i, float threshold) {
  static const float mean =
      texture_mean([](const TextureSample& c) { return single_barnacle(c.nearest, c.id); });
  const Cells& shells = f.barnacles;
  const float colony =
      smooth_step(threshold, threshold + 0.06F, f.colony.v[i] + 0.15F * f.turf.v[i]);
  return colony *
         mix(mean, single_barnacle(shells.nearest.v[i], shells.id.v[i]), shells.weight.v[i]);
}

// A higher `threshold` gives fewer colonies.
void add_fouling(SurfaceBatch& s, std::uint32_t seed, float threshold, Fouling& f) {
  fbm(s.p, {.frequency = 1.6F, .octaves = 4, .gain = 0.6F, .seed = seed}, f.colony);
  fbm(s.p, {.frequency = 5.0F, .octaves = 5, .gain = 0.65F, .seed = seed + 1}, f.turf);
  cells(s.p, 30.0F, seed + 2, f.barnacles);
  for (int i = 0; i < kBatch; ++i) f.cover.v[i] = barnacle_cover(f, i, threshold);
  static const Dome shell = make_dome(30.0F, 0.006F, 0.45F);
  bump_cells(s, f.barnacles, f.cover, shell);
}

float barnacle_shade(float nearest, float id) {
  const float mouth = smooth_step(0.05F, 0.11F, nearest);
  return (0.3F + 0.7F * mouth) * (0.75F + 0.45F * id);
}

Color barnacle_color(const Fouling& f, int i) {
  static const float mean = [] {
    const float cover =
        texture_mean([](const TextureSample& c) { return single_barnacle(c.nearest, c.id); });
    return texture_mean([](const TextureSample& c) {
             return single_barnacle(c.nearest, c.id) * barnacle_shade(c.nearest, c.id);
           }) /
           cover;
  }();
  const Cells& shells = f.barnacles;
  return Color{0.54F, 0.50F, 0.43F} *
         mix(mean, barnacle_shade(shells.nearest.v[i], shells.id.v[i]), shells.weight.v[i]);
}

}  // namespace

void steel(SurfaceBatch& s) {
  static constexpr Color kPaint[] = {
      {0.30F, 0.33F, 0.33F}, {0.36F, 0.20F, 0.15F}, {0.27F, 0.31F, 0.36F}};
  Lanes rust, streaks, fine;
  Gradient pits;
  Fouling life;
  fbm(s.p, {.frequency = 1.1F, .octaves = 6, .gain = 0.62F, .seed = 111}, rust);
  fbm(s.p, {.frequency = 7.0F, .octaves = 3, .gain = 0.6F, .seed = 112, .stretch = {1, 1, 0.09F}},
      streaks);
  fbm(s.p, {.frequency = 35.0F, .octaves = 3, .gain = 0.8F, .seed = 113}, fine);
  fbm_gradient(s.p, {.frequency = 14.0F, .octaves = 4, .gain = 0.6F, .seed = 114}, pits);
  add_fouling(s, 115, 0.16F, life);
  bump(s, pits, 0.007F);
  for (int i = 0; i < kBatch; ++i) {
    const float seam = 1.0F - s.detail.v[i];
    Color c = pick(kPaint, 3, s.object.v[i]) * (1.0F + 0.35F * fine.v[i]);
    const float eaten =
        smooth_step(-0.12F, 0.2F, rust.v[i] + 0.5F * seam + 0.25F * pits.value.v[i]);
    const Color orange = mix({0.30F, 0.17F, 0.09F}, {0.52F, 0.27F, 0.11F},
                             clamp01(0.5F + 1.4F * fine.v[i] + pits.value.v[i]));
    c = mix(c, orange, 0.92F * eaten);
    const float upright = 1.0F - magnitude(s.nz.v[i]);
    c = mix(c, {0.42F, 0.20F, 0.08F}, 0.75F * upright * smooth_step(0.08F, 0.4F, streaks.v[i]));
    c = mix(c, {0.16F, 0.13F, 0.11F}, 0.6F * upright * smooth_step(0.1F, 0.4F, -streaks.v[i]));
    // Sheets of encrusting sponge and coralline algae.
    c = mix(c, Color{0.46F, 0.28F, 0.26F} * (1.0F + 0.6F * fine.v[i]),
            0.6F * smooth_step(0.18F, 0.36F, -rust.v[i] + 0.4F * life.turf.v[i]));
    c = mix(c, Color{0.42F, 0.34F, 0.25F} * (1.0F + 0.6F * fine.v[i]),
            0.5F * smooth_step(0.2F, 0.4F, -life.colony.v[i] + 0.5F * life.turf.v[i]));
    const float up = smooth_step(-0.1F, 0.7F, s.nz.v[i]);
    c = mix(c, Color{0.20F, 0.23F, 0.10F} * (1.0F + fine.v[i]),
            (0.35F + 0.5F * up) * smooth_step(0.0F, 0.35F, life.turf.v[i]));
    c = mix(c, {0.46F, 0.42F, 0.33F}, 0.6F * up * smooth_step(-0.1F, 0.3F, rust.v[i] + fine.v[i]));
    c = mix(c, barnacle_color(life, i), life.cover.v[i]);
    set_color(s, i, c * (1.0F - 0.55F * smooth_step(0.4F, 1.0F, seam)));
  }
}

void wood(SurfaceBatch& s) {
  Lanes grain, tone, fine, fine_lost_variance;
  Fouling life;
  fbm(s.p, {.frequency = 40.0F, .octaves = 3, .gain = 0.7F, .seed = 121, .stretch = {0.06F, 1, 1}},
      grain);
  fbm(s.p, {.frequency = 2.0F, .octaves = 5, .gain = 0.6F, .seed = 122}, tone);
  fbm(s.p, {.frequency = 60.0F, .octaves = 2, .gain = 0.8F, .seed = 123}, fine, fine_lost_variance);
  add_fouling(s, 124, 0.24F, life);
  for (int i = 0; i < kBatch; ++i) {
    const float plank = 0.8F + 0.4F * s.object.v[i];
    Color c = Color{0.33F, 0.27F, 0.19F} * (plank + 0.7F * grain.v[i] + 0.4F * tone.v[i]);
    c = mix(c, Color{0.22F, 0.25F, 0.11F} * (1.0F + fine.v[i]),
            0.8F * smooth_step(0.0F, 0.35F, life.turf.v[i]));
    c = mix(c, {0.50F, 0.45F, 0.35F},
            0.7F * smooth_step(0.5F, 0.9F, s.nz.v[i]) *
                smooth_step(-0.1F, 0.35F, tone.v[i] + fine.v[i], fine_lost_variance.v[i]));
    c = mix(c, barnacle_color(life, i), life.cover.v[i]);
    set_color(s, i, c * (0.45F + 0.55F * s.detail.v[i]));
  }
}

void concrete(SurfaceBatch& s) {
  Lanes tone, streaks, fine, warp, veins;
  Gradient skin;
  Cells holes;
  Fouling life;
  fbm(s.p, {.frequency = 0.7F, .octaves = 5, .gain = 0.6F, .seed = 131}, tone);
  fbm(s.p, {.frequency = 3.5F, .octaves = 4, .gain = 0.6F, .seed = 132, .stretch = {1, 1, 0.06F}},
      streaks);
  fbm(s.p, {.frequency = 40.0F, .octaves = 4, .gain = 0.85F, .seed = 133}, fine);
  fbm(s.p, {.frequency = 0.35F, .octaves = 4, .gain = 0.5F, .seed = 134}, veins);
  fbm(s.p, {.frequency = 1.2F, .octaves = 2, .gain = 0.5F, .seed = 135}, warp);
  fbm_gradient(s.p, {.frequency = 12.0F, .octaves = 5, .gain = 0.6F, .seed = 136}, skin);
  cells(s.p, 19.0F, 137, holes);
  add_fouling(s, 138, 0.2F, life);
  bump(s, skin, 0.0035F);
  for (int i = 0; i < kBatch; ++i) {
    const float joint = 1.0F - s.detail.v[i];
    const float upright = 1.0F - magnitude(s.nz.v[i]);
    Color c = Color{0.46F, 0.45F, 0.40F} *
              (1.0F + 0.35F * tone.v[i] + 0.3F * fine.v[i] + 0.25F * skin.value.v[i]);
    // Formwork board marks: a change of tone every 16 cm of height.
    const float board = s.p.z.v[i] * 6.25F + 0.15F * warp.v[i];
    const float level = static_cast<float>(static_cast<int>(board - 1000.0F));
    const float place = board - 1000.0F - level + 1.0F;
    const float edge = smooth_step(0.06F, 0.0F, place) + smooth_step(0.94F, 1.0F, place);
    const float plank = unit_float(hash32(static_cast<std::uint32_t>(static_cast<int>(level))));
    const float near = smooth_step(0.05F, 0.01F, s.p.footprint.v[i]);
    const float dark = mix(0.06F, edge, near);
    c = c * (1.0F + upright * (0.14F * (plank - 0.5F) - 0.16F * dark));
    c = mix(c, {0.17F, 0.16F, 0.11F},
            0.7F * upright * smooth_step(0.05F, 0.4F, streaks.v[i] + 0.4F * tone.v[i]));
    c = mix(c, {0.70F, 0.69F, 0.64F},
            0.75F * upright * smooth_step(0.28F, 0.5F, -streaks.v[i] + 0.3F * joint));
    c = mix(c, {0.40F, 0.24F, 0.10F},
            0.6F * upright * smooth_step(0.3F, 0.5F, streaks.v[i] - 0.6F * tone.v[i]));
    // Casting voids, and cracks along the zero crossings of a low-frequency field.
    const bool open = holes.id.v[i] > 0.45F;
    const float hole =
        holes.weight.v[i] * smooth_step(0.05F + 0.16F * holes.id.v[i], 0.03F, holes.nearest.v[i]);
    c = c * (1.0F - (open ? 0.75F * hole : 0.0F));
    const float crack =
        smooth_step(0.003F + 0.4F * s.p.footprint.v[i], 0.0F, magnitude(veins.v[i])) *
        smooth_step(0.05F, 0.25F, warp.v[i]);
    c = c * (1.0F - 0.7F * crack);
    const float turf = smooth_step(-0.02F, 0.34F, life.turf.v[i] + 0.5F * life.colony.v[i]);
    c = mix(c, Color{0.19F, 0.24F, 0.10F} * (1.0F + 0.8F * fine.v[i]), 0.75F * turf);
    c = mix(c, {0.48F, 0.44F, 0.35F}, 0.8F * smooth_step(0.5F, 0.9F, s.nz.v[i]));
    c = mix(c, barnacle_color(life, i), life.cover.v[i]);
    set_color(s, i, c * (1.0F - 0.6F * smooth_step(0.2F, 1.0F, joint)));
  }
  add_mussel_beds(s);
}

}  // namespace apvi::sim::texture

// NOLINTEND(cppcoreguidelines-pro-type-member-init)
