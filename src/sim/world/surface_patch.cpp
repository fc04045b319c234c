// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/surface_patch.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

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
  if (!mesh.texture.empty()) {
    const Vector3f at = blend(mesh.texture);
    const float scale = (mesh.texture[t[1]] - mesh.texture[t[0]]).norm() /
                        std::max(1e-6F, (mesh.vertices[t[1]] - mesh.vertices[t[0]]).norm());
    patch.texture.x[i] = at.x();
    patch.texture.y[i] = at.y();
    patch.texture.z[i] = at.z();
    patch.texture.footprint[i] = scale * s.p.footprint[i];
  }
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

// With texture coordinates, the points are replaced by these meanwhile.
void evaluate(Material material, bool has_texture, Patch& patch) {
  if (!has_texture) return evaluate_material(material, patch.surface);
  patch.texture.count = patch.surface.p.count;
  std::swap(patch.texture, patch.surface.p);
  evaluate_material(material, patch.surface);
  std::swap(patch.texture, patch.surface.p);
}

// Copies the first point into the unused lanes, so that kernels can process full batches.
void pad(Patch& patch, bool has_texture) {
  SurfaceBatch& s = patch.surface;
  for (Lanes* lanes :
       {&s.p.x, &s.p.y, &s.p.z, &s.p.footprint, &s.nx, &s.ny, &s.nz, &s.detail, &s.object,
        &patch.sky, &patch.sun, &patch.range, &patch.dx, &patch.dy, &patch.dz}) {
    std::fill(lanes->v + s.p.count, lanes->v + kBatch, lanes->v[0]);
  }
  if (!has_texture) return;
  Points& t = patch.texture;
  for (Lanes* lanes : {&t.x, &t.y, &t.z, &t.footprint}) {
    std::fill(lanes->v + s.p.count, lanes->v + kBatch, lanes->v[0]);
  }
}

}  // namespace

void for_each_patch(const TriangleMesh& mesh, const BakedLight& baked, const TileRays& tile,
                    const std::function<void(Patch&)>& use) {
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
    const bool has_texture = !mesh.texture.empty();
    pad(patch, has_texture);
    evaluate(static_cast<Material>(m), has_texture, patch);
    apply_tints(mesh.tints, patch.surface);
    use(patch);
  }
}

}  // namespace apvi::sim
