// SPDX-License-Identifier: BSD-3-Clause
#include <array>
#include <cmath>
#include <numbers>

#include "sim/world/fish.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

constexpr float kTwoPi = 2.0F * std::numbers::pi_v<float>;
constexpr float kOrigin = 0.4F;   // of the frame, from the nose [lengths]
constexpr float kDepth = 0.135F;  // half the height of the body at its deepest [lengths]
constexpr float kRear = 0.86F;    // end of the body

constexpr int kRows = 18;
constexpr int kSides = 12;

struct Outline {
  float u, size;  ///< place along the body; part of the half height
};
constexpr std::array<Outline, 11> kOutline = {{{0.0F, 0.05F},
                                               {0.02F, 0.3F},
                                               {0.06F, 0.52F},
                                               {0.14F, 0.78F},
                                               {0.25F, 0.96F},
                                               {0.36F, 1.0F},
                                               {0.5F, 0.9F},
                                               {0.64F, 0.64F},
                                               {0.76F, 0.34F},
                                               {0.83F, 0.22F},
                                               {kRear, 0.24F}}};

float half_height(float u) {
  std::size_t k = 1;
  while (k + 1 < kOutline.size() && kOutline[k].u < u) ++k;
  const Outline& a = kOutline[k - 1];
  const Outline& b = kOutline[k];
  return kDepth * (a.size + (b.size - a.size) * (u - a.u) / (b.u - a.u));
}

// Flatter toward the tail.
float half_width(float u) {
  return half_height(u) * (0.52F - 0.3F * u);
}

// A point at `u` of the body; y and z in lengths.
struct BodyPoint {
  float u, y, z;
  Vector3f texture;
};

class Builder {
 public:
  Builder(TriangleMesh& mesh, const FishPose& pose) : mesh_(mesh), pose_(pose) {}

  /// A sheet of (columns + 1) x (rows + 1) points.
  template <typename Point>
  void sheet(int columns, int rows, float detail, const Point& point) {
    const auto first = static_cast<std::uint32_t>(mesh_.vertices.size());
    for (int j = 0; j <= rows; ++j) {
      for (int i = 0; i <= columns; ++i) add(point(i, j), detail);
    }
    const auto stride = static_cast<std::uint32_t>(columns + 1);
    for (std::uint32_t j = 0; j < static_cast<std::uint32_t>(rows); ++j) {
      for (std::uint32_t i = 0; i + 1 < stride; ++i) {
        const std::uint32_t a = first + j * stride + i;
        mesh_.add_quad(a, a + 1, a + 1 + stride, a + stride, Material::fish, pose_.species);
      }
    }
  }

 private:
  // The wave of the body runs backward and grows toward the tail.
  void add(const BodyPoint& p, float detail) {
    const float swing = (0.01F + 0.09F * p.u * p.u) * std::sin(0.9F * kTwoPi * p.u - pose_.beat);
    mesh_.add_vertex(
        pose_.T_world_fish * (pose_.length * Vector3f(kOrigin - p.u, p.y + swing, p.z)), detail);
    mesh_.texture.push_back(p.texture);
  }

  TriangleMesh& mesh_;
  const FishPose& pose_;
};

float fraction(int i, int count) {
  return static_cast<float>(i) / static_cast<float>(count);
}

void add_body(Builder& builder) {
  builder.sheet(kSides, kRows, 1.0F, [](int i, int j) {
    const float along = fraction(j, kRows);
    const float u = kRear * along * (0.35F + 0.65F * along);  // more rows at the head
    const float angle = kTwoPi * fraction(i, kSides);
    const float up = -std::cos(angle);
    const float side = std::sin(angle);
    return BodyPoint{u, half_width(u) * side, half_height(u) * up, {u, up, side}};
  });
}

void add_tail(Builder& builder) {
  constexpr int kSpan = 8;
  constexpr int kChord = 3;
  builder.sheet(kSpan, kChord, 0.0F, [](int i, int j) {
    const float across = 2.0F * fraction(i, kSpan) - 1.0F;
    const float back = fraction(j, kChord);
    const float end = 0.9F + 0.1F * std::abs(across);  // forked
    const float u = 0.83F + (end - 0.83F) * back;
    return BodyPoint{u, 0.0F, across * (0.028F + 0.11F * back), {u, across, 0.0F}};
  });
}

// A fin along the back (up: 1) or the belly (up: -1).
void add_ridge_fin(Builder& builder, float from, float to, float height, float up) {
  constexpr int kColumns = 8;
  constexpr int kFinRows = 2;
  builder.sheet(kColumns, kFinRows, 0.0F, [=](int i, int j) {
    const float along = fraction(i, kColumns);
    const float rise = fraction(j, kFinRows);
    const float shape = std::sqrt(along) * (1.0F - 0.75F * along) * 1.9F;
    const float root = from + (to - from) * along;
    const float u = root + 0.04F * rise;  // swept back
    const float z = 0.92F * half_height(root) + height * shape * rise;
    return BodyPoint{u, 0.0F, up * z, {u, up * (1.0F + rise), 0.0F}};
  });
}

void add_side_fin(Builder& builder, float side) {
  builder.sheet(2, 2, 0.0F, [=](int i, int j) {
    const float across = fraction(i, 2) - 0.5F;
    const float out = fraction(j, 2);
    const float u = 0.27F + 0.11F * out;
    const float y = side * (0.9F * half_width(0.27F) + 0.055F * out);
    const float z = -0.25F * kDepth - 0.035F * out + across * (0.025F + 0.03F * out);
    return BodyPoint{u, y, z, {u, across, side}};
  });
}

}  // namespace

void add_fish(TriangleMesh& mesh, const FishPose& pose) {
  Builder builder(mesh, pose);
  add_body(builder);
  add_tail(builder);
  add_ridge_fin(builder, 0.3F, 0.72F, 0.06F, 1.0F);
  add_ridge_fin(builder, 0.56F, 0.76F, 0.05F, -1.0F);
  add_side_fin(builder, -1.0F);
  add_side_fin(builder, 1.0F);
}

std::size_t fish_vertex_count() {
  static const std::size_t count = [] {
    TriangleMesh one;
    add_fish(one, {.T_world_fish = Eigen::Affine3f::Identity(), .length = 1.0F});
    return one.vertices.size();
  }();
  return count;
}

}  // namespace apvi::sim
