// SPDX-License-Identifier: BSD-3-Clause
#include "sim/shading.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>

#include "sim/clones.hpp"
#include "sim/material.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

/// The points of one tile that hit one material.
struct Patch {
  SurfaceBatch surface;
  Lanes sky{}, sun{}, range{}, dx{}, dy{}, dz{};
  Lanes light[3]{};
  std::array<int, kBatch> lane{};  ///< index in the tile of each point
};

struct Channels {
  float v[3];
};

Channels channels(const Eigen::Vector3d& rgb) {
  return {{static_cast<float>(rgb.x()), static_cast<float>(rgb.y()), static_cast<float>(rgb.z())}};
}

void gather_point(const TriangleMesh& mesh, const BakedLight& baked, const TileRays& tile, int lane,
                  int i, Patch& patch) {
  const auto k = static_cast<std::size_t>(lane);
  const RayBatch& rays = tile.rays;
  const TriangleMesh::Triangle& t = mesh.triangles[rays.triangle[k]];
  const float wb = rays.u[k];
  const float wc = rays.v[k];
  const float wa = 1.0F - wb - wc;
  const auto blend = [&](const auto& values) {
    return wa * values[t[0]] + wb * values[t[1]] + wc * values[t[2]];
  };
  const Vector3f d(rays.dx[k], rays.dy[k], rays.dz[k]);
  const Vector3f facet =
      (mesh.vertices[t[1]] - mesh.vertices[t[0]]).cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]);
  Vector3f n = Vector3f(blend(baked.normals)).normalized();
  if (facet.dot(d) > 0.0F) n = -n;  // hit from behind: surfaces are two-sided
  const float range = rays.range[k];
  SurfaceBatch& s = patch.surface;
  s.p.x[i] = rays.ox[k] + range * d.x();
  s.p.y[i] = rays.oy[k] + range * d.y();
  s.p.z[i] = rays.oz[k] + range * d.z();
  const float slant = std::max(0.15F, std::abs(facet.dot(d)) / facet.norm());
  s.p.footprint[i] = range * tile.pixel_angle[lane] / std::sqrt(slant);
  s.nx[i] = n.x();
  s.ny[i] = n.y();
  s.nz[i] = n.z();
  s.detail[i] = blend(mesh.detail);
  s.object[i] = unit_float(hash32(mesh.objects[rays.triangle[k]]));
  patch.sky[i] = blend(baked.sky);
  patch.sun[i] = blend(baked.sun);
  patch.range[i] = range;
  patch.dx[i] = d.x();
  patch.dy[i] = d.y();
  patch.dz[i] = d.z();
  patch.lane[static_cast<std::size_t>(i)] = lane;
}

// Copies the first point into the unused lanes, so that kernels can process full batches.
void pad(Patch& patch) {
  SurfaceBatch& s = patch.surface;
  for (Lanes* lanes :
       {&s.p.x, &s.p.y, &s.p.z, &s.p.footprint, &s.nx, &s.ny, &s.nz, &s.detail, &s.object,
        &patch.sky, &patch.sun, &patch.range, &patch.dx, &patch.dy, &patch.dz}) {
    std::fill(lanes->v + s.p.count, lanes->v + kBatch, lanes->v[0]);
  }
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
APVI_CLONES void caustics(const Points& p, const std::array<Wave, kWaves>& waves, float shear_x,
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

void light_patch(const LightState& light, const TileRays& tile, Patch& patch) {
  const Eigen::Vector3d sun = sun_direction(light.config);
  Lanes caustic{};
  caustic.fill(1.0F);
  if (light.config.caustics > 0.0) {
    caustics(patch.surface.p, caustic_waves(light.config, light.time_s),
             static_cast<float>(sun.x() / sun.z()), static_cast<float>(sun.y() / sun.z()),
             static_cast<float>(light.config.caustics), caustic);
  }
  const DaylightTerms daylight{.surface = channels(daylight_at(light.config, light.medium, 0.0)),
                               .k_d = channels(light.medium.k_d),
                               .sun_x = static_cast<float>(sun.x()),
                               .sun_y = static_cast<float>(sun.y()),
                               .sun_z = static_cast<float>(sun.z()),
                               .direct_fraction = static_cast<float>(light.config.direct_fraction)};
  add_daylight(daylight, caustic, patch);
  if (light.config.lamp) add_lamp(lamp_terms(light, tile), patch);
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

// Adds a drifting cloud of silt in front of the camera, from noise sampled at a few distances.
void add_silt(const LightState& light, TileRays& tile) {
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
      p.x[i] = rays.ox[k] + distance * rays.dx[k] - 0.12F * static_cast<float>(light.time_s);
      p.y[i] = rays.oy[k] + distance * rays.dy[k];
      p.z[i] = rays.oz[k] + distance * rays.dz[k] - 0.04F * static_cast<float>(light.time_s);
      p.footprint[i] = 0.01F;
    }
    p.count = count;
    fbm(p, {.frequency = 1.1F, .octaves = 5, .gain = 0.55F, .seed = 301}, density);
    // Thin clouds have gaps, dense ones do not.
    const auto silt = static_cast<float>(light.silt);
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
      tile.observed[c][i] = tile.observed[c][i] * left + light.silt_color[c] * (1.0F - left);
    }
  }
}

void shade_surfaces(const TriangleMesh& mesh, const BakedLight& baked, const LightState& light,
                    TileRays& tile) {
  const int count = static_cast<int>(tile.rays.size());
  std::uint32_t present = 0;
  std::array<std::uint8_t, kBatch> material{};
  for (int i = 0; i < count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    material[k] = 255;
    if (tile.rays.range[k] < 0.0F) continue;
    material[k] = static_cast<std::uint8_t>(mesh.materials[tile.rays.triangle[k]]);
    present |= 1U << material[k];
  }
  Patch patch;
  for (int m = 0; m < kMaterialCount; ++m) {
    if ((present & (1U << m)) == 0) continue;
    int n = 0;
    for (int i = 0; i < count; ++i) {
      if (material[static_cast<std::size_t>(i)] == m) {
        gather_point(mesh, baked, tile, i, n++, patch);
      }
    }
    patch.surface.p.count = n;
    pad(patch);
    evaluate_material(static_cast<Material>(m), patch.surface);
    light_patch(light, tile, patch);
    scatter_patch(patch, tile);
  }
}

}  // namespace

void shade(const TriangleMesh& mesh, const BakedLight& baked, const LightState& light,
           TileRays& tile) {
  for (Lanes& lanes : tile.clear) lanes.fill(0.0F);
  shade_surfaces(mesh, baked, light, tile);
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
  if (light.silt > 0.0) add_silt(light, tile);
}

}  // namespace apvi::sim
