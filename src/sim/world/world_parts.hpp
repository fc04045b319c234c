// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "core/random.hpp"
#include "sim/world/mesh.hpp"
#include "sim/world/world.hpp"

/// Parts of worlds; each function appends to a mesh.
namespace apvi::sim::parts {

using Eigen::Affine3f;
using Eigen::Vector3f;

inline float uniform(Random& random, double low, double high) {
  return static_cast<float>(random.uniform(low, high));
}

/// The bed as a height field.
class Terrain {
 public:
  Terrain(const WorldConfig& config, std::uint64_t seed);
  float height(float x, float y) const;  ///< z [m]
  /// 1 on rocky reef, 0 on sand.
  float reef(float x, float y) const;
  /// Texture strength: 0 in bare patches, 1 outside.
  float richness(float x, float y) const;
  void append_to(TriangleMesh& mesh) const;

 private:
  float ripples(float x, float y) const;

  WorldConfig config_;
  std::uint32_t seed_;
  float ripple_x_, ripple_y_;  // wave vector [1/m]
};

/// Single objects. `T` places the base at its origin, upright along its z axis; `size` [m] is the
/// approximate height or width.
void add_boulder(TriangleMesh& mesh, const Vector3f& at, float radius, Random& random,
                 std::uint16_t object, Material material = Material::rock);
void add_brain_coral(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object);
void add_branch_coral(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                      std::uint16_t object);
void add_plate_coral(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object);
void add_tube_sponge(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object);
void add_fan(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
             std::uint16_t object);
void add_weed(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
              std::uint16_t object);
/// A random coral, sponge or weed; on walls only those that grow on walls.
enum class Ground { bed, wall };
void add_marine_life(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object, Ground ground);
/// A tire that lies on the bed, 0.7 m wide.
void add_tire(TriangleMesh& mesh, const Affine3f& T, std::uint16_t object);
/// A mooring block of 0.6 x 0.5 x 0.4 m.
void add_block(TriangleMesh& mesh, const Affine3f& T, std::uint16_t object);
/// A random tire, pipe, plank, drum, jar or concrete block lying on the bed.
void add_debris(TriangleMesh& mesh, const Vector3f& at, Random& random, std::uint16_t object);

void scatter_rocks(TriangleMesh& mesh, const Terrain& terrain, const WorldConfig& config,
                   Random random);
void scatter_marine_life(TriangleMesh& mesh, const Terrain& terrain, const WorldConfig& config,
                         Random random);
void scatter_debris(TriangleMesh& mesh, const Terrain& terrain, const WorldConfig& config,
                    Random random);
/// Adds marine life to existing surfaces, on `count` random triangles of the given range.
void add_surface_growth(TriangleMesh& mesh, std::size_t first_triangle, std::size_t last_triangle,
                        int count, float size, Random random);

void add_wreck(TriangleMesh& mesh, const WorldConfig& config, const Terrain& terrain,
               Random random);
void add_dam(TriangleMesh& mesh, const WorldConfig& config, Random random);

}  // namespace apvi::sim::parts
