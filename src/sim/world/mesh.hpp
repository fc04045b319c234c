// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "sim/world/material.hpp"

namespace apvi::sim {

/// A triangle mesh in world coordinates: z up, water surface at z = 0 [m].
struct TriangleMesh {
  using Triangle = std::array<std::uint32_t, 3>;

  std::vector<Eigen::Vector3f> vertices;  ///< [m]
  std::vector<float>
      detail;  ///< per vertex, texture strength, 0 (bare) to 1; bed: 1 to 2, sand to rock
  std::vector<Triangle> triangles;     ///< vertex indices, counter-clockwise seen from outside
  std::vector<Material> materials;     ///< per triangle
  std::vector<std::uint16_t> objects;  ///< per triangle: object id, varies colors between objects
  std::vector<Tint> tints;             ///< where surfaces have another color
  /// Per vertex: where its solid texture is evaluated; empty: at the vertex. For what moves.
  std::vector<Eigen::Vector3f> texture;

  std::uint32_t add_vertex(const Eigen::Vector3f& position, float vertex_detail = 1.0F);
  void add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c, Material material,
                    std::uint16_t object = 0);
  /// Two triangles; a, b, c, d counter-clockwise seen from outside.
  void add_quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d,
                Material material, std::uint16_t object = 0);
  /// Appends `other`, moved by `T_this_other`.
  void append(const TriangleMesh& other, const Eigen::Affine3f& T_this_other);
  Eigen::AlignedBox3f bounds() const;
};

/// Unit normal of every vertex, the area-weighted mean of its triangles' normals.
std::vector<Eigen::Vector3f> vertex_normals(const TriangleMesh& mesh);
/// Binary PLY with vertices, faces and a `material` number per face. Throws RunError when the file
/// cannot be written.
void write_ply(const TriangleMesh& mesh, const std::filesystem::path& path);

}  // namespace apvi::sim
