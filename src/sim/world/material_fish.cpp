// SPDX-License-Identifier: BSD-3-Clause
// Fish, in the texture coordinates of `add_fish`.
#include "sim/world/material_kernels.hpp"

namespace apvi::sim::texture {
namespace {

struct Species {
  Color back, flank, belly, fin;
  float bars, stripe, spots;  ///< strength of its pattern
};
constexpr Species kSpecies[] = {{{0.09F, 0.14F, 0.20F},
                                 {0.46F, 0.50F, 0.52F},
                                 {0.78F, 0.78F, 0.74F},
                                 {0.36F, 0.34F, 0.18F},
                                 0.0F,
                                 1.0F,
                                 0.0F},
                                {{0.34F, 0.32F, 0.12F},
                                 {0.60F, 0.60F, 0.50F},
                                 {0.74F, 0.74F, 0.68F},
                                 {0.30F, 0.28F, 0.20F},
                                 1.0F,
                                 0.0F,
                                 0.0F},
                                {{0.26F, 0.14F, 0.08F},
                                 {0.56F, 0.30F, 0.14F},
                                 {0.70F, 0.58F, 0.44F},
                                 {0.48F, 0.22F, 0.10F},
                                 0.0F,
                                 0.0F,
                                 1.0F}};

float bar_at(float u, float w) {
  const float cycles = 6.5F * u;
  const float phase = cycles - static_cast<float>(static_cast<int>(cycles));
  return smooth_step(0.3F, 0.16F, magnitude(phase - 0.5F)) * smooth_step(-0.7F, -0.2F, w);
}

float spot_at(float nearest) {
  return smooth_step(0.3F, 0.2F, nearest);
}

Color add_head(const Color& skin, float u, float w) {
  const float bend = u - 0.03F * w * w;
  const float gill = smooth_step(0.012F, 0.004F, magnitude(bend - 0.215F));
  const Color c = mix(skin, skin * 0.45F, gill * smooth_step(0.95F, 0.6F, magnitude(w)));
  const float x = (u - 0.085F) / 0.026F;
  const float y = (w - 0.28F) / 0.3F;
  const float r = __builtin_sqrtf(x * x + y * y);
  const Color iris = mix(c, {0.72F, 0.68F, 0.42F}, smooth_step(1.05F, 0.9F, r));
  return mix(iris, {0.02F, 0.02F, 0.02F}, smooth_step(0.68F, 0.55F, r));
}

}  // namespace

void fish(SurfaceBatch& s) {
  Lanes mottle;  // NOLINT(cppcoreguidelines-pro-type-member-init): scratch, filled before use
  Cells spots;   // NOLINT(cppcoreguidelines-pro-type-member-init)
  fbm(s.p, {.frequency = 6.0F, .octaves = 3, .gain = 0.6F, .seed = 111}, mottle);
  cells(s.p, 11.0F, 112, spots);
  static const float mean =
      texture_mean([](const TextureSample& place) { return spot_at(place.nearest); });
  for (int i = 0; i < kBatch; ++i) {
    const Species& species = kSpecies[static_cast<int>(3.0F * s.object.v[i])];
    const float u = s.p.x.v[i];
    const float w = s.p.y.v[i];
    const float shade = w + 0.25F * mottle.v[i];
    Color c = mix(species.flank, species.back, smooth_step(-0.05F, 0.6F, shade));
    c = mix(c, species.belly, smooth_step(-0.25F, -0.75F, shade));
    c = mix(c, {0.62F, 0.52F, 0.12F},
            species.stripe * smooth_step(0.14F, 0.07F, magnitude(w - 0.12F)));
    c = mix(c, {0.06F, 0.06F, 0.07F}, species.bars * bar_at(u, w));
    const float spot = mix(mean, spot_at(spots.nearest.v[i]), spots.weight.v[i]);
    c = mix(c, {0.74F, 0.66F, 0.52F}, species.spots * spot);
    c = add_head(c * (1.0F + 0.35F * mottle.v[i]), u, w);
    const Color fin = species.fin * (0.85F + 0.5F * mottle.v[i]);
    set_color(s, i, mix(fin, c, s.detail.v[i]));
  }
}

}  // namespace apvi::sim::texture
