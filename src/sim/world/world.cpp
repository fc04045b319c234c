// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/world.hpp"

#include "sim/world/world_parts.hpp"

namespace apvi::sim {

TriangleMesh make_world(const WorldConfig& config, std::uint64_t seed) {
  const Random random(seed);
  TriangleMesh mesh;
  const parts::Terrain terrain(config, seed);
  terrain.append_to(mesh);
  if (config.kind == WorldKind::ship) parts::add_wreck(mesh, config, terrain, random.fork(1));
  if (config.kind == WorldKind::dam) parts::add_dam(mesh, config, random.fork(2));
  parts::scatter_rocks(mesh, terrain, config, random.fork(3));
  parts::scatter_marine_life(mesh, terrain, config, random.fork(4));
  parts::scatter_debris(mesh, terrain, config, random.fork(5));
  for (const TriangleMesh& object : make_objects(config, seed)) {
    mesh.append(object, Eigen::Affine3f::Identity());
  }
  mesh.tints = make_tints(config);
  return mesh;
}

}  // namespace apvi::sim
