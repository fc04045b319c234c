// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/shading.hpp"

#include <cmath>
#include <iterator>
#include <numbers>

#include "sim/render/caustics.hpp"
#include "sim/render/silt.hpp"
#include "sim/world/clones.hpp"
#include "sim/world/moving_scene.hpp"
#include "sim/world/surface_patch.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

struct Channels {
  float v[3];
};

Channels channels(const Eigen::Vector3d& rgb) {
  return {{static_cast<float>(rgb.x()), static_cast<float>(rgb.y()), static_cast<float>(rgb.z())}};
}

struct DaylightTerms {
  Channels surface, k_d;
  float sun_x, sun_y, sun_z, direct_fraction;
};

APVI_CLONES void add_daylight(const DaylightTerms& terms, const Lanes& caustic, Patch& patch) {
  const SurfaceBatch& s = patch.surface;
  for (int i = 0; i < kBatch; ++i) {
    const float depth = s.p.z.v[i] < 0.0F ? -s.p.z.v[i] : 0.0F;
    const float facing =
        s.nx.v[i] * terms.sun_x + s.ny.v[i] * terms.sun_y + s.nz.v[i] * terms.sun_z;
    const float direct = facing > 0.0F ? facing / terms.sun_z : 0.0F;
    // Direct and diffuse light add up to 1 on a horizontal plane; downward faces receive light
    // reflected by the bed.
    const float diffuse = patch.sky.v[i] * (0.5F + 0.5F * s.nz.v[i] + 0.10F * (1.0F - s.nz.v[i]));
    const float geometry = (1.0F - terms.direct_fraction) * diffuse +
                           terms.direct_fraction * patch.sun.v[i] * direct * caustic.v[i];
    for (int c = 0; c < 3; ++c) {
      patch.light[c].v[i] = geometry * terms.surface.v[c] * fast_exp(-terms.k_d.v[c] * depth);
    }
  }
}

struct LampTerms {
  Channels color{}, beta_d{};
  Vector3f position = Vector3f::Zero();
  Vector3f axis = Vector3f::UnitZ();
  float falloff = 0.0F;  ///< ln 2 / (1 - cos beam)
};

LampTerms lamp_terms(const LightState& light, const TileRays& tile) {
  const LampConfig& lamp = *light.config.lamp;
  const double half = std::cos(lamp.half_beam_deg * std::numbers::pi / 180.0);
  LampTerms terms;
  for (std::size_t c = 0; c < 3; ++c) {
    terms.color.v[c] = static_cast<float>(lamp.intensity * lamp.color[c]);
  }
  terms.beta_d = channels(light.medium.beta_d);
  terms.position = tile.lamp_position;
  terms.axis = tile.lamp_axis;
  terms.falloff = static_cast<float>(std::numbers::ln2 / (1.0 - half));
  return terms;
}

// Same as lamp_beam(), with a factor instead of a branch, so that loops vectorize.
inline float beam_falloff(float falloff, float cosine) {
  return fast_exp(-falloff * (1.0F - cosine)) * static_cast<float>(cosine > 0.0F);
}

APVI_CLONES void add_lamp(const LampTerms& lamp, Patch& patch) {
  const SurfaceBatch& s = patch.surface;
  const float px = lamp.position.x(), py = lamp.position.y(), pz = lamp.position.z();
  const float ax = lamp.axis.x(), ay = lamp.axis.y(), az = lamp.axis.z();
  for (int i = 0; i < kBatch; ++i) {
    const float x = s.p.x.v[i] - px;
    const float y = s.p.y.v[i] - py;
    const float z = s.p.z.v[i] - pz;
    float d = __builtin_sqrtf(x * x + y * y + z * z);
    d = d < 0.05F ? 0.05F : d;
    const float cosine = (x * ax + y * ay + z * az) / d;
    const float facing = -(x * s.nx.v[i] + y * s.ny.v[i] + z * s.nz.v[i]) / d;
    const float geometry =
        (facing > 0.0F ? facing : 0.0F) * beam_falloff(lamp.falloff, cosine) / (d * d);
    for (int c = 0; c < 3; ++c) {
      patch.light[c].v[i] += geometry * lamp.color.v[c] * fast_exp(-lamp.beta_d.v[c] * d);
    }
  }
}

void light_patch(const LightState& light, const TileRays& tile, Patch& patch) {
  const Eigen::Vector3d sun = sun_direction(light.config);
  Lanes caustic{};
  caustics(light.config, light.time_s, patch.surface.p, caustic);
  const DaylightTerms daylight{.surface = channels(daylight_at(light.config, light.medium, 0.0)),
                               .k_d = channels(light.medium.k_d),
                               .sun_x = static_cast<float>(sun.x()),
                               .sun_y = static_cast<float>(sun.y()),
                               .sun_z = static_cast<float>(sun.z()),
                               .direct_fraction = static_cast<float>(light.config.direct_fraction)};
  add_daylight(daylight, caustic, patch);
  if (light.config.lamp) add_lamp(lamp_terms(light, tile), patch);
}

void add_moving_shadows(const LightState& light, Patch& patch, TileRays& tile) {
  SurfaceBatch& s = patch.surface;
  const auto shadowed =
      cast_shadows(*light.moving, sun_direction(light.config).cast<float>(),
                   {.p = s.p, .nx = s.nx, .ny = s.ny, .nz = s.nz, .sun = patch.sun});
  for (std::size_t i = 0; i < static_cast<std::size_t>(s.p.count); ++i) {
    if (shadowed[i]) tile.moving[static_cast<std::size_t>(patch.lane[i])] = kMovingShadow;
  }
}

void scatter_patch(const Patch& patch, TileRays& tile) {
  const SurfaceBatch& s = patch.surface;
  for (int i = 0; i < s.p.count; ++i) {
    const int lane = patch.lane[static_cast<std::size_t>(i)];
    tile.clear[0][lane] = s.r[i] * patch.light[0][i];
    tile.clear[1][lane] = s.g[i] * patch.light[1][i];
    tile.clear[2][lane] = s.b[i] * patch.light[2][i];
  }
}

struct MediumTerms {
  Channels beta_d, beta_b, b_inf;
  float gradient;
};

// Without a surface, the range is so large that only veiling light remains.
APVI_CLONES void add_medium(const MediumTerms& medium, const float* range, const float* dz,
                            int count, TileRays& tile) {
  for (int i = 0; i < count; ++i) {
    const float r = range[i] < 0.0F ? 1e4F : range[i];
    const float brightening = 1.0F + medium.gradient * dz[i];
    for (int c = 0; c < 3; ++c) {
      tile.observed[c].v[i] =
          tile.clear[c].v[i] * fast_exp(-medium.beta_d.v[c] * r) +
          medium.b_inf.v[c] * brightening * (1.0F - fast_exp(-medium.beta_b.v[c] * r));
    }
  }
}

// Backscatter of the lamp from the water between `near` and `far` [m] along the ray.
APVI_CLONES void add_backscatter_segment(const LampTerms& lamp, float strength, float near,
                                         float far, const RayBatch& rays, int count,
                                         TileRays& tile) {
  const float* ox = rays.ox.data();
  const float* oy = rays.oy.data();
  const float* oz = rays.oz.data();
  const float* dx = rays.dx.data();
  const float* dy = rays.dy.data();
  const float* dz = rays.dz.data();
  const float* range = rays.range.data();
  const float lx = lamp.position.x(), ly = lamp.position.y(), lz = lamp.position.z();
  const float ax = lamp.axis.x(), ay = lamp.axis.y(), az = lamp.axis.z();
#pragma GCC ivdep  // rays and colors do not alias
  for (int i = 0; i < count; ++i) {
    const float end = range[i] < 0.0F || range[i] > far ? far : range[i];
    const float length = end > near ? end - near : 0.0F;
    const float along = near + 0.5F * length;
    const float x = ox[i] + along * dx[i] - lx;
    const float y = oy[i] + along * dy[i] - ly;
    const float z = oz[i] + along * dz[i] - lz;
    float d = __builtin_sqrtf(x * x + y * y + z * z);
    d = d < 0.05F ? 0.05F : d;
    const float cosine = (x * ax + y * ay + z * az) / d;
    const float geometry = strength * beam_falloff(lamp.falloff, cosine) * length / (d * d);
    for (int c = 0; c < 3; ++c) {
      tile.observed[c].v[i] +=
          geometry * lamp.color.v[c] * fast_exp(-lamp.beta_d.v[c] * (d + along));
    }
  }
}

// Integrates from the lens in steps that grow with distance: most backscatter comes from the first
// half meter, where the ray passes the lamp. Within 1 % of the integral for lamps next to the
// camera.
void add_lamp_backscatter(const LampTerms& lamp, float strength, TileRays& tile) {
  static constexpr float kEdges[] = {0.0F,  0.05F, 0.12F, 0.2F, 0.3F, 0.42F, 0.56F,
                                     0.75F, 1.0F,  1.4F,  2.0F, 3.0F, 4.5F,  6.0F};
  const int count = static_cast<int>(tile.rays.size());
  for (std::size_t k = 0; k + 1 < std::size(kEdges); ++k) {
    add_backscatter_segment(lamp, strength, kEdges[k], kEdges[k + 1], tile.rays, count, tile);
  }
}

}  // namespace

void shade(const TriangleMesh& mesh, const BakedLight& baked, const LightState& light,
           TileRays& tile) {
  for (Lanes& lanes : tile.clear) lanes.fill(0.0F);
  tile.moving.fill(0);
  for_each_patch(mesh, baked, tile, [&](Patch& patch) {
    if (light.moving != nullptr) add_moving_shadows(light, patch, tile);
    light_patch(light, tile, patch);
    scatter_patch(patch, tile);
  });
  const int count = static_cast<int>(tile.rays.size());
  const MediumTerms medium{.beta_d = channels(light.medium.beta_d),
                           .beta_b = channels(light.medium.beta_b),
                           .b_inf = channels(light.medium.b_inf),
                           .gradient = static_cast<float>(light.veiling_light_gradient)};
  add_medium(medium, tile.rays.range.data(), tile.rays.dz.data(), count, tile);
  if (light.config.lamp && light.config.lamp->backscatter > 0.0) {
    // The backward phase function is about 0.01 per steradian of the scattering; large particles
    // scatter without color.
    const double strength = 0.035 * light.config.lamp->backscatter * light.medium.beta_d.y();
    add_lamp_backscatter(lamp_terms(light, tile), static_cast<float>(strength), tile);
  }
  if (light.silt > 0.0) {
    add_silt({.density = light.silt, .time_s = light.time_s, .color = light.silt_color}, tile);
  }
}

}  // namespace apvi::sim
