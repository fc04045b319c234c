// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/caustics.hpp"

#include <array>
#include <cmath>

#include "sim/world/clones.hpp"

namespace apvi::sim {
namespace {

// cos(2 pi t), accurate to 1e-3; vectorizes.
inline float cos_turns(float t) {
  const int whole = static_cast<int>(t + (t < 0.0F ? -0.5F : 0.5F));
  const float f = (t - static_cast<float>(whole)) * 6.2831853F;
  const float q = f * f;
  return 1.0F - q * (0.5F - q * (0.041666668F - q * (0.0013888F - q * 2.4e-5F)));
}

struct Wave {
  float kx, ky, phase, xx, xy, yy;  ///< turns per meter, turns, second derivatives
};
constexpr int kWaves = 7;

std::array<Wave, kWaves> caustic_waves(const LightConfig& light, double time_s) {
  std::array<Wave, kWaves> waves{};
  for (std::uint32_t w = 0; w < kWaves; ++w) {
    const float angle = 6.2831853F * unit_float(hash32(w, 501));
    const float spread = 0.6F + 0.9F * unit_float(hash32(w, 502));
    const float k = spread / static_cast<float>(light.caustic_scale_m);
    const float speed = 0.5F * std::sqrt(k);  // [turns/s]: dispersion of deep-water waves
    const double turns = time_s * static_cast<double>(speed);
    const float curvature = 0.33F;  // curvature of the surface times depth: below 1 / sqrt(kWaves)
    waves[w] = {.kx = k * std::cos(angle),
                .ky = k * std::sin(angle),
                .phase = unit_float(hash32(w, 503)) - static_cast<float>(turns - std::floor(turns)),
                .xx = curvature * std::cos(angle) * std::cos(angle),
                .xy = curvature * std::cos(angle) * std::sin(angle),
                .yy = curvature * std::sin(angle) * std::sin(angle)};
  }
  return waves;
}

// Refraction by a wavy surface displaces rays by the slope, so the light density is one over the
// determinant of (identity - focal length * Hessian).
APVI_CLONES void refract(const Points& p, const std::array<Wave, kWaves>& waves, float shear_x,
                         float shear_y, float contrast, Lanes& out) {
  for (int i = 0; i < kBatch; ++i) {
    const float x = p.x.v[i] - shear_x * p.z.v[i];
    const float y = p.y.v[i] - shear_y * p.z.v[i];
    float xx = 1.0F;
    float xy = 0.0F;
    float yy = 1.0F;
    for (int w = 0; w < kWaves; ++w) {
      const Wave& wave = waves[static_cast<std::size_t>(w)];
      const float c = cos_turns(wave.kx * x + wave.ky * y + wave.phase);
      xx -= wave.xx * c;
      xy -= wave.xy * c;
      yy -= wave.yy * c;
    }
    float det = xx * yy - xy * xy;
    det = det < 0.0F ? -det : det;
    out.v[i] = 1.0F + contrast * (0.7F / (det + 0.22F) - 0.75F);
    out.v[i] = out.v[i] < 0.0F ? 0.0F : out.v[i];
  }
}

}  // namespace

void caustics(const LightConfig& light, double time_s, const Points& p, Lanes& out) {
  out.fill(1.0F);
  if (light.caustics <= 0.0) return;
  const Eigen::Vector3d sun = sun_direction(light);
  refract(p, caustic_waves(light, time_s), static_cast<float>(sun.x() / sun.z()),
          static_cast<float>(sun.y() / sun.z()), static_cast<float>(light.caustics), out);
}

}  // namespace apvi::sim
