// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/silt.hpp"

#include <algorithm>

namespace apvi::sim {

void add_silt(const SiltCloud& cloud, TileRays& tile) {
  static constexpr float kDistances[] = {0.35F, 0.8F, 1.6F};
  const RayBatch& rays = tile.rays;
  const int count = static_cast<int>(rays.size());
  Lanes depth{};
  Lanes density{};
  depth.fill(0.0F);
  Points p;
  for (const float distance : kDistances) {
    for (int i = 0; i < kBatch; ++i) {
      const auto k = static_cast<std::size_t>(i < count ? i : 0);
      p.x[i] = rays.ox[k] + distance * rays.dx[k] - 0.12F * static_cast<float>(cloud.time_s);
      p.y[i] = rays.oy[k] + distance * rays.dy[k];
      p.z[i] = rays.oz[k] + distance * rays.dz[k] - 0.04F * static_cast<float>(cloud.time_s);
      p.footprint[i] = 0.01F;
    }
    p.count = count;
    fbm(p, {.frequency = 1.1F, .octaves = 5, .gain = 0.55F, .seed = 301}, density);
    // Thin clouds have gaps, dense ones do not.
    const auto silt = static_cast<float>(cloud.density);
    const float contrast = mix(1.6F, 0.5F, std::min(1.0F, silt * silt));
    for (int i = 0; i < count; ++i) {
      const float r = rays.range[static_cast<std::size_t>(i)];
      const bool before = r < 0.0F || distance < r;
      const float local = std::max(0.0F, 0.55F + 0.45F * silt * silt + contrast * density[i]);
      depth[i] += before ? local * silt * 2.2F : 0.0F;
    }
  }
  for (int i = 0; i < count; ++i) {
    const float left = fast_exp(-depth[i]);
    for (int c = 0; c < 3; ++c) {
      tile.observed[c][i] = tile.observed[c][i] * left + cloud.color[c] * (1.0F - left);
    }
  }
}

}  // namespace apvi::sim
