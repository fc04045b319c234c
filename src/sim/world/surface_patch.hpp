// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <functional>

#include "sim/render/shading.hpp"
#include "sim/world/material.hpp"

namespace apvi::sim {

/// The points of one tile that hit one material.
struct Patch {
  SurfaceBatch surface;
  Points texture;  ///< where the material is evaluated, for meshes with texture coordinates
  Lanes sky{}, sun{}, range{}, dx{}, dy{}, dz{};
  Lanes light[3]{};
  std::array<int, kBatch> lane{};  ///< index in the tile of each point
};

/// Gathers the surfaces that the (already cast) rays of a tile hit, one patch per material,
/// evaluates their materials and hands each patch to `use`.
void for_each_patch(const TriangleMesh& mesh, const BakedLight& baked, const TileRays& tile,
                    const std::function<void(Patch&)>& use);

}  // namespace apvi::sim
