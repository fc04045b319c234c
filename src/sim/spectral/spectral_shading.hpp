// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "sim/render/shading.hpp"
#include "sim/spectral/lamp_shadow.hpp"
#include "sim/spectral/sea_state.hpp"

namespace apvi::sim {

/// What the surfaces of a tile are, and where.
struct TileSurface {
  Points p{};              ///< world [m]
  Lanes nx{}, ny{}, nz{};  ///< unit normals, toward the camera
  Lanes r{}, g{}, b{};     ///< albedo, 0 without a surface
  Lanes sun{}, sky{};      ///< visibility of both
  Lanes range{};           ///< from the camera [m]

  void clear();
};

/// Collects the surfaces that the (already cast) rays of a tile hit.
void gather_surfaces(const TriangleMesh& mesh, const BakedLight& baked, const TileRays& tile,
                     TileSurface& out);

/// Light of one frame as the shading needs it.
struct SpectralLight {
  const Sea* sea = nullptr;
  SeaState state{};
  std::vector<LampPose> lamps{};
  std::vector<LampShadow> shadows{};  ///< one per lamp; empty: no shadows
};

/// Raw values of the surfaces (Beer and Lambert): `tile.clear` as seen from next to them,
/// `tile.observed` what stays in its pixel, exp(-sharp r), and `blurred` what reaches the image
/// after scattering by small angles, exp(-smooth r) - exp(-sharp r).
void shade_spectral(const SpectralLight& light, const TileSurface& surface, TileRays& tile,
                    Lanes (&blurred)[3]);

/// Adds the sky seen through the surface of the water (within Snell's window) to rays that end
/// there.
void add_sky(const SpectralLight& light, TileRays& tile);

/// Raw values of a white particle, lit from all sides, seen from `range` [m] away; no backscatter.
Eigen::Vector3d light_on_particle(const SpectralLight& light, const Eigen::Vector3f& p,
                                  float range);

}  // namespace apvi::sim
