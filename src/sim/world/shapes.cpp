// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/shapes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

namespace apvi::sim::shapes {
namespace {

using Eigen::Affine3f;
using Eigen::Vector3f;
constexpr float kTwoPi = 2.0F * std::numbers::pi_v<float>;

struct Sphere {
  std::vector<Vector3f> points;
  std::vector<std::array<std::uint32_t, 3>> faces;
};

Sphere icosahedron() {
  const float g = 1.618034F;
  Sphere s;
  s.points = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
              {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  for (Vector3f& p : s.points) p.normalize();
  s.faces = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
             {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
             {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  return s;
}

void subdivide(Sphere& s) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
  const auto middle = [&](std::uint32_t a, std::uint32_t b) {
    const auto key = std::minmax(a, b);
    const auto found = middles.find(key);
    if (found != middles.end()) return found->second;
    s.points.push_back((s.points[a] + s.points[b]).normalized());
    const auto index = static_cast<std::uint32_t>(s.points.size() - 1);
    middles[key] = index;
    return index;
  };
  std::vector<std::array<std::uint32_t, 3>> faces;
  faces.reserve(4 * s.faces.size());
  for (const auto& f : s.faces) {
    const std::uint32_t a = middle(f[0], f[1]);
    const std::uint32_t b = middle(f[1], f[2]);
    const std::uint32_t c = middle(f[2], f[0]);
    faces.push_back({f[0], a, c});
    faces.push_back({f[1], b, a});
    faces.push_back({f[2], c, b});
    faces.push_back({a, b, c});
  }
  s.faces = std::move(faces);
}

// Clips the triangles of a grid at the zero crossings of `keep`. Mesh vertices are created on first
// use.
class GridClipper {
 public:
  GridClipper(TriangleMesh& mesh, const Skin& skin, std::vector<GridPoint> points)
      : mesh_(mesh), skin_(skin), points_(std::move(points)), vertex_(points_.size(), kNone) {}

  void add(const std::array<std::size_t, 3>& corner) {
    std::array<std::uint32_t, 4> polygon{};
    std::size_t count = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const GridPoint& a = points_[corner[k]];
      const GridPoint& b = points_[corner[(k + 1) % 3]];
      if (a.keep >= 0.0F) polygon[count++] = vertex(corner[k]);
      if ((a.keep >= 0.0F) == (b.keep >= 0.0F)) continue;
      const float u = a.keep / (a.keep - b.keep);
      polygon[count++] = mesh_.add_vertex(a.position + u * (b.position - a.position), 0.3F);
    }
    for (std::size_t k = 2; k < count; ++k) {
      mesh_.add_triangle(polygon[0], polygon[k - 1], polygon[k], skin_.material, skin_.object);
    }
  }

 private:
  static constexpr std::uint32_t kNone = ~0U;
  std::uint32_t vertex(std::size_t point) {
    if (vertex_[point] == kNone) {
      vertex_[point] = mesh_.add_vertex(points_[point].position, points_[point].detail);
    }
    return vertex_[point];
  }

  TriangleMesh& mesh_;
  Skin skin_;
  std::vector<GridPoint> points_;
  std::vector<std::uint32_t> vertex_;
};

}  // namespace

void deformed_sphere(TriangleMesh& mesh, int level, const Skin& skin,
                     const std::function<Vector3f(const Vector3f&)>& place) {
  Sphere s = icosahedron();
  for (int i = 0; i < level; ++i) subdivide(s);
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const Vector3f& p : s.points) mesh.add_vertex(place(p));
  for (const auto& f : s.faces) {
    mesh.add_triangle(first + f[0], first + f[1], first + f[2], skin.material, skin.object);
  }
}

void tube(TriangleMesh& mesh, const std::vector<Ring>& rings, int sides, const Skin& skin,
          bool capped) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  const auto n = static_cast<std::uint32_t>(sides);
  for (std::size_t i = 0; i < rings.size(); ++i) {
    const Vector3f along =
        rings[std::min(i + 1, rings.size() - 1)].center - rings[i > 0 ? i - 1 : 0].center;
    const Affine3f T = frame_along(rings[i].center, along);
    for (int k = 0; k < sides; ++k) {
      const float angle = kTwoPi * static_cast<float>(k) / static_cast<float>(sides);
      mesh.add_vertex(
          T * Vector3f(rings[i].radius * std::cos(angle), rings[i].radius * std::sin(angle), 0.0F),
          rings[i].detail);
    }
  }
  for (std::uint32_t i = 0; i + 1 < rings.size(); ++i) {
    for (std::uint32_t k = 0; k < n; ++k) {
      const std::uint32_t a = first + i * n + k;
      const std::uint32_t b = first + i * n + (k + 1) % n;
      mesh.add_quad(a, b, b + n, a + n, skin.material, skin.object);
    }
  }
  if (!capped) return;
  const std::uint32_t bottom = mesh.add_vertex(rings.front().center, rings.front().detail);
  const std::uint32_t top = mesh.add_vertex(rings.back().center, rings.back().detail);
  const std::uint32_t last = first + (static_cast<std::uint32_t>(rings.size()) - 1) * n;
  for (std::uint32_t k = 0; k < n; ++k) {
    mesh.add_triangle(bottom, first + (k + 1) % n, first + k, skin.material, skin.object);
    mesh.add_triangle(top, last + k, last + (k + 1) % n, skin.material, skin.object);
  }
}

void lathe(TriangleMesh& mesh, const Affine3f& T, const std::vector<Ring>& profile, int sides,
           const Skin& skin, float radius_ripple) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  const auto n = static_cast<std::uint32_t>(sides);
  for (const Ring& step : profile) {
    for (int k = 0; k < sides; ++k) {
      const float angle = kTwoPi * static_cast<float>(k) / static_cast<float>(sides);
      const float radius = step.radius * (1.0F + radius_ripple * std::sin(11.0F * angle));
      mesh.add_vertex(T * Vector3f(step.center.x() + radius * std::cos(angle),
                                   step.center.y() + radius * std::sin(angle), step.center.z()),
                      step.detail);
    }
  }
  for (std::uint32_t i = 0; i + 1 < profile.size(); ++i) {
    for (std::uint32_t k = 0; k < n; ++k) {
      const std::uint32_t a = first + i * n + k;
      const std::uint32_t b = first + i * n + (k + 1) % n;
      mesh.add_quad(a, b, b + n, a + n, skin.material, skin.object);
    }
  }
}

void box(TriangleMesh& mesh, const Affine3f& T, const Vector3f& half, const Skin& skin,
         float cell) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {-1.0F, 1.0F}) {
      const int u = (axis + 1) % 3;
      const int v = (axis + 2) % 3;
      const int nu = std::max(2, static_cast<int>(std::ceil(2.0F * half[u] / cell)));
      const int nv = std::max(2, static_cast<int>(std::ceil(2.0F * half[v] / cell)));
      grid(mesh, nu, nv, skin, [&](int i, int j) {
        Vector3f p;
        p[axis] = side * half[axis];
        p[u] = side * half[u] * (2.0F * static_cast<float>(i) / static_cast<float>(nu) - 1.0F);
        p[v] = half[v] * (2.0F * static_cast<float>(j) / static_cast<float>(nv) - 1.0F);
        const bool edge = i == 0 || j == 0 || i == nu || j == nv;
        return GridPoint{T * p, edge ? 0.3F : 1.0F};
      });
    }
  }
}

void grid(TriangleMesh& mesh, int columns, int rows, const Skin& skin,
          const std::function<GridPoint(int, int)>& point) {
  std::vector<GridPoint> points;
  for (int j = 0; j <= rows; ++j) {
    for (int i = 0; i <= columns; ++i) points.push_back(point(i, j));
  }
  GridClipper clipper(mesh, skin, std::move(points));
  const auto stride = static_cast<std::size_t>(columns + 1);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const std::size_t a = static_cast<std::size_t>(j) * stride + static_cast<std::size_t>(i);
      clipper.add({a, a + 1, a + 1 + stride});
      clipper.add({a, a + 1 + stride, a + stride});
    }
  }
}

Affine3f frame_along(const Vector3f& origin, const Vector3f& direction, float turn) {
  const float length = direction.norm();
  const Vector3f z = length > 0.0F ? Vector3f(direction / length) : Vector3f(Vector3f::UnitZ());
  // Use the same helper axis along a whole tube, so that its rings do not twist.
  const Vector3f helper =
      std::abs(z.y()) < 0.95F ? Vector3f(Vector3f::UnitY()) : Vector3f(Vector3f::UnitX());
  const Vector3f x = helper.cross(z).normalized();
  Affine3f T = Affine3f::Identity();
  T.linear().col(0) = x;
  T.linear().col(1) = z.cross(x);
  T.linear().col(2) = z;
  T.translation() = origin;
  T.rotate(Eigen::AngleAxisf(turn, Vector3f::UnitZ()));
  return T;
}

}  // namespace apvi::sim::shapes
