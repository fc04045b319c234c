// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/spectral_shading.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/render/caustics.hpp"
#include "sim/spectral/light_field.hpp"
#include "sim/world/clones.hpp"
#include "sim/world/surface_patch.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

constexpr float kMinLampRange = 0.02F;  // [m]; the size of a lamp

/// Light on the surfaces, without its spectrum.
struct Geometry {
  Lanes depth{};    ///< [m], at least 0
  Lanes sun{};      ///< irradiance per direct irradiance on a horizontal plane
  Lanes sky{};      ///< per diffuse irradiance on a horizontal plane
  Lanes lamp[2]{};  ///< per irradiance at 1 m on the axis of the lamp, without water
  Lanes lamp_range[2]{};
};

void add_sunlight(const SeaState& sea, const TileSurface& s, Geometry& out) {
  const Vector3f& sun = sea.sun_direction;
  Lanes caustic;  // NOLINT(cppcoreguidelines-pro-type-member-init): filled before use
  caustics(sea.light, sea.silt.time_s, s.p, caustic);
  constexpr float kBed = 0.08F;  // reflected by the bed onto surfaces that face down
  for (int i = 0; i < kBatch; ++i) {
    const float depth = -s.p.z[i];
    out.depth[i] = depth > 0.0F ? depth : 0.0F;
    const float facing = s.nx[i] * sun.x() + s.ny[i] * sun.y() + s.nz[i] * sun.z();
    out.sun[i] = facing > 0.0F ? facing / sun.z() * s.sun[i] * caustic[i] : 0.0F;
    out.sky[i] = s.sky[i] * (diffuse_irradiance().at(s.nz[i]) + kBed * 0.5F * (1.0F - s.nz[i]));
  }
}

void add_lamplight(const SpectralLight& light, std::size_t lamp, const TileSurface& s,
                   Geometry& out) {
  const LampPose& pose = light.lamps[lamp];
  const LampLobe& lobe = light.sea->lobes()[lamp];
  for (int i = 0; i < kBatch; ++i) {
    const Vector3f p(s.p.x[i], s.p.y[i], s.p.z[i]);
    const Vector3f ray = p - pose.position;
    const float range = std::max(kMinLampRange, ray.norm());
    const float facing = -(ray.x() * s.nx[i] + ray.y() * s.ny[i] + ray.z() * s.nz[i]) / range;
    out.lamp_range[lamp][i] = range;
    out.lamp[lamp][i] = 0.0F;
    if (facing <= 0.0F || s.range[i] <= 0.0F) continue;
    const float lit = light.shadows.empty() ? 1.0F : light.shadows[lamp].lit(p);
    out.lamp[lamp][i] = lit * facing * lobe.at(ray.dot(pose.axis) / range) / (range * range);
  }
}

/// The constants of one band.
struct BandTerms {
  float red, green, blue;  ///< reflectance basis
  float total, diffuse, sun, sun_decay;
  float lamp[2], smooth, sharp;
  float response[3];
};

APVI_CLONES void daylight_in_band(const BandTerms& band, const Geometry& geometry, Lanes& light) {
#pragma GCC ivdep
  for (int i = 0; i < kBatch; ++i) {
    const float total = band.total * fast_exp(-band.diffuse * geometry.depth.v[i]);
    const float sun = band.sun * fast_exp(-band.sun_decay * geometry.depth.v[i]);
    light.v[i] = geometry.sun.v[i] * sun + geometry.sky.v[i] * (total - sun);
  }
}

APVI_CLONES void add_lamp_in_band(float strength, float smooth, const Lanes& share,
                                  const Lanes& range, Lanes& light) {
#pragma GCC ivdep
  for (int i = 0; i < kBatch; ++i)
    light.v[i] += share.v[i] * strength * fast_exp(-smooth * range.v[i]);
}

// From the light on the surfaces to what leaves them, what stays in its pixel, and what is blurred.
APVI_CLONES void reflect_in_band(const BandTerms& band, const TileSurface& s, const Lanes& light,
                                 Lanes (&parts)[3]) {
#pragma GCC ivdep
  for (int i = 0; i < kBatch; ++i) {
    const float leaving =
        light.v[i] * (s.r.v[i] * band.red + s.g.v[i] * band.green + s.b.v[i] * band.blue);
    const float sharp = leaving * fast_exp(-band.sharp * s.range.v[i]);
    parts[0].v[i] = leaving;
    parts[1].v[i] = sharp;
    parts[2].v[i] = leaving * fast_exp(-band.smooth * s.range.v[i]) - sharp;
  }
}

APVI_CLONES void add_response(const BandTerms& band, const Lanes& part, Lanes (&raw)[3]) {
#pragma GCC ivdep
  for (int i = 0; i < kBatch; ++i) {
    const float value = part.v[i];
    raw[0].v[i] += band.response[0] * value;
    raw[1].v[i] += band.response[1] * value;
    raw[2].v[i] += band.response[2] * value;
  }
}

void add_band(const BandTerms& band, std::size_t lamps, const TileSurface& s,
              const Geometry& geometry, TileRays& tile, Lanes (&blurred)[3]) {
  Lanes light;     // NOLINT(cppcoreguidelines-pro-type-member-init): filled below
  Lanes parts[3];  // NOLINT(cppcoreguidelines-pro-type-member-init): filled below
  daylight_in_band(band, geometry, light);
  for (std::size_t k = 0; k < lamps; ++k)
    add_lamp_in_band(band.lamp[k], band.smooth, geometry.lamp[k], geometry.lamp_range[k], light);
  reflect_in_band(band, s, light, parts);
  add_response(band, parts[0], tile.clear);
  add_response(band, parts[1], tile.observed);
  add_response(band, parts[2], blurred);
}

BandTerms band_terms(const SpectralLight& light, const std::array<Spectrum, 3>& basis,
                     std::size_t k) {
  const SeaState& sea = light.state;
  BandTerms band{.red = static_cast<float>(basis[0][k]),
                 .green = static_cast<float>(basis[1][k]),
                 .blue = static_cast<float>(basis[2][k]),
                 .total = sea.total[k],
                 .diffuse = sea.diffuse[k],
                 .sun = sea.sun[k],
                 .sun_decay = sea.sun_decay[k],
                 .lamp = {},
                 .smooth = sea.smooth[k],
                 .sharp = sea.sharp[k],
                 .response = {}};
  for (std::size_t i = 0; i < sea.lamps.size(); ++i) band.lamp[i] = sea.lamps[i][k];
  for (std::size_t c = 0; c < 3; ++c)
    band.response[c] = static_cast<float>(light.sea->sensor().response[c][k]);
  return band;
}

}  // namespace

void TileSurface::clear() {
  for (Lanes* lanes : {&p.x, &p.y, &p.z, &nx, &ny, &r, &g, &b, &sun, &sky, &range})
    lanes->fill(0.0F);
  nz.fill(1.0F);
}

void gather_surfaces(const TriangleMesh& mesh, const BakedLight& baked, const TileRays& tile,
                     TileSurface& out) {
  out.clear();
  out.p.count = kBatch;
  for_each_patch(mesh, baked, tile, [&out](const Patch& patch) {
    const SurfaceBatch& s = patch.surface;
    for (int i = 0; i < s.p.count; ++i) {
      const int lane = patch.lane[static_cast<std::size_t>(i)];
      out.p.x[lane] = s.p.x[i];
      out.p.y[lane] = s.p.y[i];
      out.p.z[lane] = s.p.z[i];
      out.nx[lane] = s.nx[i];
      out.ny[lane] = s.ny[i];
      out.nz[lane] = s.nz[i];
      out.r[lane] = s.r[i];
      out.g[lane] = s.g[i];
      out.b[lane] = s.b[i];
      out.sun[lane] = patch.sun[i];
      out.sky[lane] = patch.sky[i];
      out.range[lane] = patch.range[i];
    }
  });
}

void shade_spectral(const SpectralLight& light, const TileSurface& surface, TileRays& tile,
                    Lanes (&blurred)[3]) {
  static const std::array<Spectrum, 3> basis = reflectance_basis();
  Geometry geometry;
  add_sunlight(light.state, surface, geometry);
  for (std::size_t i = 0; i < light.lamps.size(); ++i) add_lamplight(light, i, surface, geometry);
  for (int c = 0; c < 3; ++c)
    for (Lanes* lanes : {&tile.clear[c], &tile.observed[c], &blurred[c]}) lanes->fill(0.0F);
  for (std::size_t k = 0; k < kBands; ++k)
    add_band(band_terms(light, basis, k), light.lamps.size(), surface, geometry, tile, blurred);
}

void add_sky(const SpectralLight& light, TileRays& tile) {
  constexpr float kEdge = 0.665F;  // cosine of the critical angle
  const SeaState& sea = light.state;
  for (int i = 0; i < static_cast<int>(tile.rays.size()); ++i) {
    const auto ray = static_cast<std::size_t>(i);
    const float up = tile.rays.dz[ray];
    if (tile.rays.range[ray] >= 0.0F || up <= kEdge) continue;
    const float path = -tile.rays.oz[ray] / up;
    const float window = smooth_step(kEdge, kEdge + 0.06F, up);
    for (std::size_t k = 0; k < kBands; ++k) {
      const float sky = window * sea.total[k] * fast_exp(-sea.smooth[k] * path);
      for (int c = 0; c < 3; ++c)
        tile.observed[c][i] +=
            static_cast<float>(light.sea->sensor().response[static_cast<std::size_t>(c)][k]) * sky;
    }
  }
}

Eigen::Vector3d light_on_particle(const SpectralLight& light, const Vector3f& p, float range) {
  const SeaState& sea = light.state;
  Spectrum arriving = daylight_at(sea, -static_cast<double>(p.z())).total;
  for (std::size_t i = 0; i < light.lamps.size(); ++i) {
    const Vector3f ray = p - light.lamps[i].position;
    const float distance = std::max(0.1F, ray.norm());
    const float strength =
        light.sea->lobes()[i].at(ray.dot(light.lamps[i].axis) / distance) / (distance * distance);
    for (std::size_t k = 0; k < kBands; ++k)
      arriving[k] +=
          static_cast<double>(strength * sea.lamps[i][k] * fast_exp(-sea.smooth[k] * distance));
  }
  for (std::size_t k = 0; k < kBands; ++k)
    arriving[k] *= static_cast<double>(fast_exp(-sea.smooth[k] * range));
  return light.sea->sensor().raw(arriving);
}

}  // namespace apvi::sim
