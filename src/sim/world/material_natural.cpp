// SPDX-License-Identifier: BSD-3-Clause
// Sand, stone and marine life. Frequencies are per meter; colors are albedos.
#include "sim/world/material_kernels.hpp"

// Lanes are scratch, filled before use: clearing them would cost as much as a material.
// NOLINTBEGIN(cppcoreguidelines-pro-type-member-init)

namespace apvi::sim::texture {

namespace {

// Shell and coral rubble: pieces of varying size, shape and brightness.
struct Rubble {
  Cells pieces;
  Lanes outline;
};

void scatter_rubble(const Points& p, Rubble& rubble) {
  Lanes wx, wy;
  fbm(p, {.frequency = 30.0F, .octaves = 2, .gain = 0.6F, .seed = 16}, wx);
  fbm(p, {.frequency = 33.0F, .octaves = 2, .gain = 0.6F, .seed = 17}, wy);
  fbm(p, {.frequency = 1.1F, .octaves = 3, .gain = 0.6F, .seed = 18}, rubble.outline);
  Points warped = p;
  for (int i = 0; i < kBatch; ++i) {
    warped.x.v[i] += 0.030F * wx.v[i];
    warped.y.v[i] += 0.030F * wy.v[i];
  }
  cells(warped, 15.0F, 15, rubble.pieces);
}

Color add_rubble(const Rubble& rubble, int i, const Color& ground, float rich) {
  const float id = rubble.pieces.id.v[i];
  const float other = id * 17.0F - static_cast<float>(static_cast<int>(id * 17.0F));
  const float size = 0.05F + 0.30F * other * other;
  const float cover = rich * rubble.pieces.weight.v[i] *
                      smooth_step(size, 0.75F * size, rubble.pieces.nearest.v[i]);
  // Rubble forms clusters.
  const bool there = id < 0.35F + 0.9F * rubble.outline.v[i];
  const Color tint = mix({0.20F, 0.17F, 0.13F}, {0.74F, 0.70F, 0.62F}, other > 0.4F ? other : 0.0F);
  return mix(ground, tint, there ? 0.9F * cover : 0.0F);
}

void pure_sand(SurfaceBatch& s) {
  Lanes wide, mottle, grain;
  Gradient relief;
  Rubble rubble;
  fbm(s.p, {.frequency = 0.35F, .octaves = 3, .gain = 0.6F, .seed = 11}, wide);
  fbm(s.p, {.frequency = 4.0F, .octaves = 4, .gain = 0.65F, .seed = 12}, mottle);
  fbm(s.p, {.frequency = 70.0F, .octaves = 3, .gain = 0.9F, .seed = 13}, grain);
  fbm_gradient(s.p, {.frequency = 9.0F, .octaves = 4, .gain = 0.5F, .seed = 14}, relief);
  scatter_rubble(s.p, rubble);
  bump(s, relief, 0.016F);
  for (int i = 0; i < kBatch; ++i) {
    const float rich = s.detail.v[i] > 1.0F ? 1.0F : s.detail.v[i];
    const float light = 1.0F + 0.25F * wide.v[i] +
                        rich * (0.4F * mottle.v[i] + 0.5F * grain.v[i] + 0.3F * relief.value.v[i]);
    Color c = mix({0.60F, 0.53F, 0.40F}, {0.44F, 0.41F, 0.33F}, clamp01(0.5F + wide.v[i]));
    const float film = rich * 0.5F * smooth_step(0.15F, 0.6F, mottle.v[i] + 0.6F * wide.v[i]);
    c = mix(c * light, {0.24F, 0.22F, 0.13F}, film);  // patches of dark diatom film
    set_color(s, i, add_rubble(rubble, i, c, rich));
  }
}

// Whether any value of the batch exceeds `threshold`.
bool any_above(const Lanes& lanes, int count, float threshold) {
  for (int i = 0; i < count; ++i) {
    if (lanes[i] > threshold) return true;
  }
  return false;
}

float norm(const SurfaceBatch& s, int i) {
  return __builtin_sqrtf(s.nx.v[i] * s.nx.v[i] + s.ny.v[i] * s.ny.v[i] + s.nz.v[i] * s.nz.v[i]);
}

const Lanes& full_cover() {
  static const Lanes ones = [] {
    Lanes lanes{};
    lanes.fill(1.0F);
    return lanes;
  }();
  return ones;
}

// Blends colors and normals of `top` over `s` with the given weights.
void blend(SurfaceBatch& s, const SurfaceBatch& top, const Lanes& weight) {
  for (int i = 0; i < kBatch; ++i) {
    const float w = weight.v[i];
    s.r.v[i] = sim::mix(s.r.v[i], top.r.v[i], w);
    s.g.v[i] = sim::mix(s.g.v[i], top.g.v[i], w);
    s.b.v[i] = sim::mix(s.b.v[i], top.b.v[i], w);
    const float x = sim::mix(s.nx.v[i], top.nx.v[i], w);
    const float y = sim::mix(s.ny.v[i], top.ny.v[i], w);
    const float z = sim::mix(s.nz.v[i], top.nz.v[i], w);
    const float length = sim::mix(norm(s, i), norm(top, i), w);
    const float scale = length / __builtin_sqrtf(x * x + y * y + z * z + 1e-12F);
    s.nx.v[i] = x * scale;
    s.ny.v[i] = y * scale;
    s.nz.v[i] = z * scale;
  }
}

}  // namespace

// Seabed: sand where `detail` is up to 1, stone where it is 2, with an irregular border in between.
void sand(SurfaceBatch& s) {
  if (!any_above(s.detail, s.p.count, 1.0F)) return pure_sand(s);
  SurfaceBatch stone = s;
  Lanes weight;
  fbm(s.p, {.frequency = 1.7F, .octaves = 6, .gain = 0.65F, .seed = 19}, weight);
  for (int i = 0; i < kBatch; ++i) {
    weight.v[i] = smooth_step(1.40F, 1.52F, s.detail.v[i] + 0.55F * weight.v[i]);
    stone.object.v[i] = 0.1F;
  }
  rock(stone);
  pure_sand(s);
  blend(s, stone, weight);
}

void silt(SurfaceBatch& s) {
  Lanes wide;
  fbm(s.p, {.frequency = 0.5F, .octaves = 2, .gain = 0.5F, .seed = 21}, wide);
  for (int i = 0; i < kBatch; ++i) {
    set_color(s, i, Color{0.40F, 0.37F, 0.30F} * (1.0F + 0.08F * wide.v[i]));
  }
}

void rock(SurfaceBatch& s) {
  static constexpr Color kStone[] = {
      {0.40F, 0.36F, 0.30F}, {0.33F, 0.33F, 0.32F}, {0.47F, 0.40F, 0.29F}, {0.36F, 0.30F, 0.26F}};
  Lanes patches, algae, fine, fine_lost_variance;
  Gradient relief;
  Cells spots;
  fbm(s.p, {.frequency = 2.2F, .octaves = 4, .gain = 0.6F, .seed = 31}, patches);
  fbm(s.p, {.frequency = 5.0F, .octaves = 5, .gain = 0.65F, .seed = 32}, algae);
  fbm(s.p, {.frequency = 45.0F, .octaves = 3, .gain = 0.8F, .seed = 33}, fine, fine_lost_variance);
  fbm_gradient(s.p, {.frequency = 6.0F, .octaves = 5, .gain = 0.55F, .seed = 34}, relief);
  cells(s.p, 28.0F, 35, spots);
  bump(s, relief, 0.05F);
  for (int i = 0; i < kBatch; ++i) {
    const float shade = 1.0F + 0.7F * relief.value.v[i] + 0.55F * fine.v[i];
    Color c = pick(kStone, 4, s.object.v[i]) * shade;
    // Turf on upward faces, pink coralline algae, dark cavities, pale barnacle spots.
    const float up = clamp01(0.35F + 0.65F * s.nz.v[i]);
    c = mix(c, Color{0.20F, 0.24F, 0.09F} * shade,
            0.85F * up * smooth_step(-0.05F, 0.3F, algae.v[i]));
    c = mix(c, Color{0.52F, 0.26F, 0.33F} * shade, 0.8F * smooth_step(0.16F, 0.34F, patches.v[i]));
    c = mix(c, Color{0.50F, 0.34F, 0.12F} * shade, 0.7F * smooth_step(0.2F, 0.36F, -patches.v[i]));
    c = c * (1.0F - 0.5F * smooth_step(0.22F, 0.5F, -relief.value.v[i]));
    const float colony = smooth_step(0.1F, 0.3F, algae.v[i] - patches.v[i]);
    const float barnacle =
        spots.weight.v[i] * colony * smooth_step(0.32F, 0.22F, spots.nearest.v[i]);
    const float mouth = smooth_step(0.06F, 0.10F, spots.nearest.v[i]);
    c = mix(c, Color{0.68F, 0.64F, 0.56F} * (0.35F + 0.65F * mouth),
            spots.id.v[i] > 0.35F ? barnacle : 0.0F);
    set_color(s, i,
              mix(c, {0.52F, 0.47F, 0.37F},
                  0.75F * smooth_step(0.82F, 0.97F, s.nz.v[i] + 0.25F * fine.v[i],
                                      0.0625F * fine_lost_variance.v[i] + tilt_variance(s, i))));
  }
}

void brain_coral(SurfaceBatch& s) {
  static constexpr Color kRidges[] = {
      {0.54F, 0.44F, 0.27F}, {0.42F, 0.41F, 0.26F}, {0.52F, 0.37F, 0.28F}};
  static constexpr float kMaze = 26.0F;
  Gradient maze;
  Lanes wide;
  fbm_gradient(s.p, {.frequency = kMaze, .octaves = 1, .gain = 0.5F, .seed = 41}, maze);
  fbm(s.p, {.frequency = 3.0F, .octaves = 4, .gain = 0.6F, .seed = 42}, wide);
  Gradient ridge = maze;
  for (int i = 0; i < kBatch; ++i) {  // zero crossings of the field are the valleys
    const float side = maze.value.v[i] < 0.0F ? -1.0F : 1.0F;
    ridge.dx.v[i] *= side;
    ridge.dy.v[i] *= side;
    ridge.dz.v[i] *= side;
  }
  bump(s, ridge, 0.018F);
  const auto valley_at = [](float x) { return smooth_step(0.2F, 0.02F, magnitude(x)); };
  static const float mean = texture_mean([&](const TextureSample& p) { return valley_at(p.wave); });
  for (int i = 0; i < kBatch; ++i) {
    const float seen = octave_weight(s.p.footprint.v[i], kMaze);
    const float valley = mix(mean, valley_at(maze.value.v[i] / (seen + 1e-6F)), seen);
    Color c = pick(kRidges, 3, s.object.v[i]) * (1.0F + 0.5F * wide.v[i]);
    c = mix(c, {0.20F, 0.22F, 0.12F}, 0.8F * valley);
    set_color(s, i, mix(c, {0.62F, 0.58F, 0.48F}, 0.7F * smooth_step(0.28F, 0.42F, wide.v[i])));
  }
}

void branch_coral(SurfaceBatch& s) {
  static constexpr Color kBranches[] = {
      {0.55F, 0.40F, 0.18F}, {0.36F, 0.34F, 0.42F}, {0.48F, 0.33F, 0.16F}, {0.40F, 0.42F, 0.22F}};
  Lanes tone;
  Cells polyps;
  fbm(s.p, {.frequency = 7.0F, .octaves = 4, .gain = 0.6F, .seed = 51}, tone);
  cells(s.p, 110.0F, 52, polyps);
  const auto polyp_at = [](float nearest) { return smooth_step(0.5F, 0.2F, nearest); };
  static const float mean =
      texture_mean([&](const TextureSample& c) { return polyp_at(c.nearest); });
  static const Dome dome = make_dome(110.0F, 0.003F, 0.6F);
  bump_cells(s, polyps, full_cover(), dome);
  for (int i = 0; i < kBatch; ++i) {
    const float polyp = mix(mean, polyp_at(polyps.nearest.v[i]), polyps.weight.v[i]);
    Color c = pick(kBranches, 4, s.object.v[i]) * (0.9F + 0.5F * tone.v[i] + 0.35F * polyp);
    const float old = smooth_step(0.35F, 0.0F, s.detail.v[i]);  // dead and overgrown at the base
    c = mix(c, {0.25F, 0.22F, 0.16F}, 0.8F * old);
    set_color(s, i, mix(c, {0.80F, 0.76F, 0.68F}, smooth_step(0.8F, 1.0F, s.detail.v[i])));
  }
}

void plate_coral(SurfaceBatch& s) {
  static constexpr Color kPlates[] = {
      {0.40F, 0.38F, 0.20F}, {0.50F, 0.38F, 0.24F}, {0.34F, 0.36F, 0.30F}};
  Lanes tone;
  Gradient knobs;
  fbm(s.p, {.frequency = 4.0F, .octaves = 5, .gain = 0.65F, .seed = 61}, tone);
  fbm_gradient(s.p, {.frequency = 40.0F, .octaves = 2, .gain = 0.5F, .seed = 62}, knobs);
  bump(s, knobs, 0.008F);
  for (int i = 0; i < kBatch; ++i) {
    Color c = pick(kPlates, 3, s.object.v[i]) * (1.0F + 0.6F * tone.v[i] + 0.6F * knobs.value.v[i]);
    c = mix(c, {0.56F, 0.50F, 0.40F}, 0.6F * smooth_step(0.22F, 0.4F, tone.v[i]));
    set_color(s, i, mix(c, {0.74F, 0.71F, 0.60F}, 0.8F * smooth_step(0.86F, 0.98F, s.detail.v[i])));
  }
}

void sponge(SurfaceBatch& s) {
  static constexpr Color kSponges[] = {
      {0.66F, 0.34F, 0.08F}, {0.68F, 0.55F, 0.12F}, {0.42F, 0.20F, 0.38F}, {0.58F, 0.16F, 0.10F}};
  Lanes tone;
  Cells pores;
  fbm(s.p, {.frequency = 9.0F, .octaves = 4, .gain = 0.6F, .seed = 71}, tone);
  cells(s.p, 45.0F, 72, pores);
  const auto pore_at = [](float nearest) { return smooth_step(0.38F, 0.15F, nearest); };
  static const float mean =
      texture_mean([&](const TextureSample& c) { return pore_at(c.nearest); });
  static const Dome dome = make_dome(45.0F, -0.006F, 0.5F);
  bump_cells(s, pores, full_cover(), dome);
  for (int i = 0; i < kBatch; ++i) {
    const float pore = mix(mean, pore_at(pores.nearest.v[i]), pores.weight.v[i]);
    const Color c = pick(kSponges, 4, s.object.v[i]) * (1.0F + 0.5F * tone.v[i]);
    set_color(s, i, mix(c, c * 0.25F, 0.85F * pore));
  }
}

void fan_coral(SurfaceBatch& s) {
  static constexpr Color kFans[] = {
      {0.46F, 0.16F, 0.30F}, {0.60F, 0.30F, 0.10F}, {0.50F, 0.42F, 0.14F}};
  Lanes tone;
  Cells mesh;
  fbm(s.p, {.frequency = 6.0F, .octaves = 3, .gain = 0.6F, .seed = 81}, tone);
  cells(s.p, 38.0F, 82, mesh);
  const auto strand_at = [](float border) { return smooth_step(0.2F, 0.06F, border); };
  static const float mean =
      texture_mean([&](const TextureSample& c) { return strand_at(c.border); });
  for (int i = 0; i < kBatch; ++i) {
    const float strand = mix(mean, strand_at(mesh.border.v[i]), mesh.weight.v[i]);
    const Color c = pick(kFans, 3, s.object.v[i]) * (1.0F + 0.5F * tone.v[i]);
    set_color(s, i, c * (0.35F + 0.75F * strand));
  }
}

void weed(SurfaceBatch& s) {
  static constexpr Color kWeeds[] = {
      {0.20F, 0.22F, 0.07F}, {0.28F, 0.20F, 0.08F}, {0.13F, 0.22F, 0.08F}};
  Lanes veins;
  fbm(s.p, {.frequency = 18.0F, .octaves = 3, .gain = 0.6F, .seed = 91, .stretch = {1, 1, 0.2F}},
      veins);
  for (int i = 0; i < kBatch; ++i) {
    const Color c =
        pick(kWeeds, 3, s.object.v[i]) * (0.8F + 0.7F * veins.v[i] + 0.5F * s.detail.v[i]);
    set_color(s, i, c);
  }
}

void mussels(SurfaceBatch& s) {
  Cells shells;
  Lanes tone;
  cells(s.p, 24.0F, 101, shells);
  fbm(s.p, {.frequency = 6.0F, .octaves = 4, .gain = 0.6F, .seed = 102}, tone);
  const auto gap_at = [](float border) { return smooth_step(0.12F, 0.02F, border); };
  static const float mean_gap =
      texture_mean([&](const TextureSample& c) { return gap_at(c.border); });
  static const Dome dome = make_dome(24.0F, 0.020F, 0.75F);
  bump_cells(s, shells, full_cover(), dome);
  for (int i = 0; i < kBatch; ++i) {
    const float gap = mix(mean_gap, gap_at(shells.border.v[i]), shells.weight.v[i]);
    const float own = shells.id.v[i];
    Color c = mix({0.10F, 0.11F, 0.14F}, {0.30F, 0.27F, 0.22F}, mix(0.5F, own, shells.weight.v[i]));
    c = c * (1.0F + 0.6F * tone.v[i]);
    c = mix(c, {0.55F, 0.52F, 0.46F}, mix(0.08F, own > 0.9F ? 0.8F : 0.0F, shells.weight.v[i]));
    c = mix(c, {0.24F, 0.26F, 0.10F}, 0.7F * smooth_step(0.1F, 0.35F, tone.v[i]));
    set_color(s, i, c * (1.0F - 0.7F * gap));
  }
}

void add_mussel_beds(SurfaceBatch& s) {
  Lanes weight, ragged;
  fbm(s.p, {.frequency = 0.55F, .octaves = 5, .gain = 0.6F, .seed = 504}, weight);
  fbm(s.p, {.frequency = 6.0F, .octaves = 4, .gain = 0.65F, .seed = 506}, ragged);
  for (int i = 0; i < kBatch; ++i) {
    weight.v[i] = smooth_step(0.24F, 0.27F, weight.v[i] + 0.3F * ragged.v[i]);
  }
  if (!any_above(weight, s.p.count, 0.0F)) return;
  SurfaceBatch bed = s;
  mussels(bed);
  blend(s, bed, weight);
}

}  // namespace apvi::sim::texture

// NOLINTEND(cppcoreguidelines-pro-type-member-init)
