// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/world/noise_texture.hpp"
#include "sim/world/shapes.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim::parts {
namespace {

constexpr float kApron = 90.0F;  // [m] of coarse bed around the fine square, beyond the visibility

// Grid lines: evenly spaced over the fine square, with increasing spacing outside.
std::vector<float> grid_lines(double size, double spacing) {
  std::vector<float> lines;
  const int half = static_cast<int>(std::ceil(0.5 * size / spacing));
  for (int i = 0; i <= half; ++i) lines.push_back(static_cast<float>(i * spacing));
  auto step = static_cast<float>(spacing);
  while (lines.back() < static_cast<float>(0.5 * size) + kApron) {
    step *= 1.25F;
    lines.push_back(lines.back() + step);
  }
  std::vector<float> both;
  for (auto it = lines.rbegin(); it + 1 != lines.rend(); ++it) both.push_back(-*it);
  both.insert(both.end(), lines.begin(), lines.end());
  return both;
}

}  // namespace

Terrain::Terrain(const WorldConfig& config, std::uint64_t seed)
    : config_(config), seed_(hash32(static_cast<std::uint32_t>(seed ^ (seed >> 32)))) {
  const float angle = 0.5F + unit_float(hash32(seed_, 1));
  const float wavelength = 0.28F + 0.14F * unit_float(hash32(seed_, 2));
  ripple_x_ = std::cos(angle) / wavelength;
  ripple_y_ = std::sin(angle) / wavelength;
}

float Terrain::richness(float x, float y) const {
  float rich = 1.0F;
  for (const BarePatch& patch : config_.bare_patches) {
    const float distance =
        std::hypot(x - static_cast<float>(patch.x_m), y - static_cast<float>(patch.y_m));
    const auto radius = static_cast<float>(patch.radius_m);
    rich = std::min(rich, smooth_step(radius, 1.25F * radius + 0.2F, distance));
  }
  return rich;
}

float Terrain::reef(float x, float y) const {
  if (config_.rocks <= 0.0) return 0.0F;
  const float wide =
      fbm({x, y, 0.0F}, {.frequency = 0.09F, .octaves = 4, .gain = 0.55F, .seed = seed_ + 3});
  const float level = config_.kind == WorldKind::seabed ? 0.02F : 0.22F;
  return smooth_step(level, level + 0.16F, wide) * richness(x, y);
}

float Terrain::ripples(float x, float y) const {
  const float warp =
      fbm({x, y, 0.0F}, {.frequency = 0.5F, .octaves = 3, .gain = 0.5F, .seed = seed_ + 4});
  const float strength = smooth_step(
      -0.25F, 0.15F,
      fbm({x, y, 0.0F}, {.frequency = 0.15F, .octaves = 2, .gain = 0.5F, .seed = seed_ + 5}));
  const float phase = ripple_x_ * x + ripple_y_ * y + 1.6F * warp;
  const float turn = phase - std::floor(phase);
  // Steep lee side, gentle stoss side.
  const float crest = turn < 0.65F ? turn / 0.65F : (1.0F - turn) / 0.35F;
  return strength * crest * crest * (3.0F - 2.0F * crest);
}

float Terrain::height(float x, float y) const {
  const float rich = richness(x, y);
  const float hills =
      fbm({x, y, 0.0F}, {.frequency = 0.05F, .octaves = 3, .gain = 0.5F, .seed = seed_ + 6});
  const float mounds =
      fbm({x, y, 0.0F}, {.frequency = 0.45F, .octaves = 4, .gain = 0.5F, .seed = seed_ + 7});
  const float rocky = reef(x, y);
  float z =
      static_cast<float>(-config_.depth_m + 2.5 * config_.relief_m * static_cast<double>(hills));
  z += 0.22F * rich * mounds;
  z += static_cast<float>(config_.ripple_height_m) * rich * (1.0F - rocky) * ripples(x, y);
  if (rocky > 0.0F) {
    const float ridge =
        1.0F - std::abs(fbm({x, y, 3.0F},
                            {.frequency = 0.7F, .octaves = 5, .gain = 0.55F, .seed = seed_ + 8}));
    z += rocky * static_cast<float>(std::min(1.5, config_.rocks)) * (0.75F * ridge * ridge - 0.1F);
  }
  return z;
}

void Terrain::append_to(TriangleMesh& mesh) const {
  const std::vector<float> lines = grid_lines(config_.size_m, config_.resolution_m);
  const int cells = static_cast<int>(lines.size()) - 1;
  const auto line = [&](int i) { return lines[static_cast<std::size_t>(i)]; };
  shapes::grid(mesh, cells, cells, {.material = Material::sand, .object = 0}, [&](int i, int j) {
    const float x = line(i);
    const float y = line(j);
    const float rocky = reef(x, y);
    const float rich = 0.06F + 0.94F * richness(x, y);
    return shapes::GridPoint{{x, y, height(x, y)}, rocky > 0.0F ? 1.0F + rocky : rich};
  });
}

}  // namespace apvi::sim::parts
