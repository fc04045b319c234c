// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <vector>

#include "sim/world/mesh.hpp"

/// Primitive solids of the worlds. All functions append to a mesh, in its coordinates [m].
namespace apvi::sim::shapes {

struct Skin {
  Material material = Material::plain;
  std::uint16_t object = 0;
};

/// A sphere of 10 * 4^level + 2 vertices; `place` maps the unit sphere's points to the mesh.
void deformed_sphere(TriangleMesh& mesh, int level, const Skin& skin,
                     const std::function<Eigen::Vector3f(const Eigen::Vector3f&)>& place);

struct Ring {
  Eigen::Vector3f center;
  float radius;
  float detail = 1.0F;
};
/// A round tube through the rings, its ends closed when `capped`.
void tube(TriangleMesh& mesh, const std::vector<Ring>& rings, int sides, const Skin& skin,
          bool capped = true);
/// A body of revolution about T's z axis: radius and height of each step of the profile.
void lathe(TriangleMesh& mesh, const Eigen::Affine3f& T, const std::vector<Ring>& profile,
           int sides, const Skin& skin, float radius_ripple = 0.0F);

/// A box with sides of 2 * half, its faces divided into cells of about `cell` m; edges have a
/// detail of 0.3.
void box(TriangleMesh& mesh, const Eigen::Affine3f& T, const Eigen::Vector3f& half,
         const Skin& skin, float cell = 0.2F);

/// A grid of (columns + 1) x (rows + 1) points. Where `keep` is negative there is a hole; its edge
/// is cut along the zero crossing between the points.
struct GridPoint {
  Eigen::Vector3f position;
  float detail = 1.0F;
  float keep = 1.0F;
};
void grid(TriangleMesh& mesh, int columns, int rows, const Skin& skin,
          const std::function<GridPoint(int, int)>& point);

/// Frame at `origin` whose z axis points along `direction`.
Eigen::Affine3f frame_along(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                            float turn = 0.0F);

}  // namespace apvi::sim::shapes
