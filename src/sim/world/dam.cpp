// SPDX-License-Identifier: BSD-3-Clause
// The upstream face of a dam: a concrete wall in the plane y = 0 with a gate and an intake.
#include <algorithm>
#include <cmath>

#include "sim/world/noise_texture.hpp"
#include "sim/world/shapes.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim::parts {
namespace {

using shapes::GridPoint;

struct Opening {
  float x0, x1, z0, z1;
  /// Chebyshev distance to the opening, negative inside.
  float distance(float x, float z) const {
    return std::max(std::max(x0 - x, x - x1), std::max(z0 - z, z - z1));
  }
};

struct Layout {
  float floor;  // z of the bed
  Opening gate, intake;
};

Layout make_layout(const WorldConfig& config) {
  const auto floor = static_cast<float>(-config.depth_m);
  const float height = std::min(5.0F, 0.55F * static_cast<float>(config.depth_m));
  return {.floor = floor,
          .gate = {-9.0F, -5.0F, floor + 0.8F, floor + 0.8F + height},
          .intake = {5.2F, 8.8F, floor + 1.2F, floor + 0.6F + 0.9F * height}};
}

void add_box(TriangleMesh& mesh, const Vector3f& low, const Vector3f& high, Material material,
             std::uint16_t object, float cell = 0.12F) {
  Affine3f T = Affine3f::Identity();
  T.translation() = 0.5F * (low + high);
  shapes::box(mesh, T, 0.5F * (high - low), {.material = material, .object = object}, cell);
}

float distance_to_joint(float x, float z) {
  const float vertical = std::abs(std::remainder(x - 1.5F, 6.0F));
  const float lift = std::abs(std::remainder(z, 1.8F));
  return std::min(vertical, 1.6F * lift);
}

// Displacement of the face from the plane y = 0 [m], positive toward the water.
float relief(float x, float z) {
  const Vector3f p(x, 0.0F, z);
  const float joint = distance_to_joint(x, z);
  const float wavy = 0.02F * fbm(p, {.frequency = 0.5F, .octaves = 3, .gain = 0.5F, .seed = 501});
  const float offset = 0.012F * (unit_float(hash32(static_cast<std::uint32_t>(
                                     static_cast<int>(std::floor(z / 1.8F)) + 1000))) -
                                 0.5F);
  const float spall_field = fbm(p, {.frequency = 0.8F, .octaves = 5, .gain = 0.55F, .seed = 502}) +
                            0.18F * std::exp(-6.0F * joint);
  const float spall = smooth_step(0.32F, 0.38F, spall_field);
  const float rough = fbm(p, {.frequency = 9.0F, .octaves = 2, .gain = 0.6F, .seed = 503});
  const float life = smooth_step(
      0.12F, 0.3F, fbm(p, {.frequency = 0.55F, .octaves = 5, .gain = 0.6F, .seed = 504}));
  const float clumps =
      0.05F + 0.07F * fbm(p, {.frequency = 5.0F, .octaves = 3, .gain = 0.6F, .seed = 505});
  return wavy + offset - 0.035F * smooth_step(0.05F, 0.0F, joint) -
         spall * (0.05F + 0.03F * rough) + life * std::max(0.0F, clumps);
}

void add_face(TriangleMesh& mesh, const WorldConfig& config, const Layout& layout) {
  const auto width = static_cast<float>(config.size_m) + 20.0F;
  const float bottom = layout.floor - 2.0F;
  const float step = std::max(0.045F, static_cast<float>(config.resolution_m) * 0.8F);
  const int columns = static_cast<int>(width / step);
  const int rows = static_cast<int>((-0.05F - bottom) / step);
  const auto x_of = [&](float i) {
    return -0.5F * width + width * i / static_cast<float>(columns);
  };
  const auto z_of = [&](float j) {
    return bottom + (-0.05F - bottom) * j / static_cast<float>(rows);
  };
  shapes::grid(
      mesh, columns, rows, {.material = Material::concrete, .object = 1}, [&](int i, int j) {
        const float x = x_of(static_cast<float>(i));
        const float z = z_of(static_cast<float>(j));
        return GridPoint{{x, -relief(x, z), z},
                         smooth_step(0.0F, 0.07F, distance_to_joint(x, z)),
                         std::min(layout.gate.distance(x, z), layout.intake.distance(x, z))};
      });
}

// Frame around an opening and the reveal walls into the dam.
void add_reveal(TriangleMesh& mesh, const Opening& o, float depth, std::uint16_t object) {
  constexpr float kFrame = 0.22F;
  constexpr float kOut = -0.10F;
  add_box(mesh, {o.x0 - kFrame, kOut, o.z0 - kFrame}, {o.x0, depth, o.z1 + kFrame},
          Material::concrete, object);
  add_box(mesh, {o.x1, kOut, o.z0 - kFrame}, {o.x1 + kFrame, depth, o.z1 + kFrame},
          Material::concrete, object);
  add_box(mesh, {o.x0, kOut, o.z1}, {o.x1, depth, o.z1 + kFrame}, Material::concrete, object);
  add_box(mesh, {o.x0, kOut - 0.1F, o.z0 - kFrame}, {o.x1, depth, o.z0}, Material::concrete,
          object);
}

void add_gate(TriangleMesh& mesh, const Opening& o) {
  add_reveal(mesh, o, 0.6F, 40);
  add_box(mesh, {o.x0, 0.42F, o.z0}, {o.x1, 0.5F, o.z1}, Material::steel, 41, 0.08F);
  const int girders = 5;
  for (int k = 0; k <= girders; ++k) {
    const float z = o.z0 + 0.1F + (o.z1 - o.z0 - 0.2F) * static_cast<float>(k) / girders;
    add_box(mesh, {o.x0 + 0.1F, 0.15F, z - 0.03F}, {o.x1 - 0.1F, 0.42F, z + 0.03F}, Material::steel,
            42);
    add_box(mesh, {o.x0 + 0.1F, 0.12F, z - 0.11F}, {o.x1 - 0.1F, 0.15F, z + 0.11F}, Material::steel,
            42);
  }
  for (float x = o.x0 + 0.7F; x < o.x1; x += 0.85F) {
    add_box(mesh, {x - 0.025F, 0.24F, o.z0}, {x + 0.025F, 0.42F, o.z1}, Material::steel, 43);
  }
  for (const float x : {o.x0 + 0.05F, o.x1 - 0.05F}) {  // guide rails
    add_box(mesh, {x - 0.05F, -0.06F, o.z0 - 0.4F}, {x + 0.05F, 0.1F, -0.1F}, Material::steel, 44);
  }
  for (const float x : {o.x0 + 1.0F, o.x1 - 1.0F}) {  // lifting rods up to the surface
    shapes::tube(mesh,
                 {{{x, 0.05F, o.z1 - 0.3F}, 0.05F},
                  {{x, 0.0F, o.z1 + 0.5F}, 0.05F},
                  {{x, -0.05F, -0.5F}, 0.05F},
                  {{x, -0.05F, 0.5F}, 0.05F}},
                 12, {.material = Material::steel, .object = 45});
  }
}

void add_intake(TriangleMesh& mesh, const Opening& o, Random& random) {
  add_reveal(mesh, o, 2.5F, 50);
  add_box(mesh, {o.x0, 2.4F, o.z0}, {o.x1, 2.5F, o.z1}, Material::concrete, 51);
  for (float x = o.x0 + 0.08F; x < o.x1; x += 0.16F) {
    const float bent = random.uniform() < 0.12 ? uniform(random, -0.12, 0.12) : 0.0F;
    std::vector<shapes::Ring> bar;
    for (int k = 0; k <= 30; ++k) {
      const float u = static_cast<float>(k) / 30.0F;
      const float bulge = bent * std::sin(3.1416F * u);
      bar.push_back({{x + bulge, 0.05F - 0.5F * bent * bulge, o.z0 + u * (o.z1 - o.z0)}, 0.022F});
    }
    shapes::tube(mesh, bar, 8, {.material = Material::steel, .object = 52});
  }
  for (float z = o.z0 + 0.5F; z < o.z1; z += 0.8F) {
    add_box(mesh, {o.x0, 0.08F, z - 0.04F}, {o.x1, 0.16F, z + 0.04F}, Material::steel, 53);
  }
  for (int k = 0; k < 14; ++k) {  // branches pressed against the bars by the current
    const Vector3f from(uniform(random, o.x0, o.x1), -0.03F, uniform(random, o.z0, o.z0 + 1.2));
    const Vector3f to = from + Vector3f(uniform(random, -0.9, 0.9), uniform(random, -0.2, 0.0),
                                        uniform(random, -0.5, 0.6));
    shapes::tube(
        mesh,
        {{from, 0.025F}, {0.5F * (from + to) + Vector3f(0, -0.05F, 0.05F), 0.02F}, {to, 0.01F}}, 7,
        {.material = Material::wood, .object = static_cast<std::uint16_t>(60 + k)});
  }
}

void add_ladder(TriangleMesh& mesh, float x, float bottom) {
  for (const float side : {-0.2F, 0.2F}) {
    shapes::tube(mesh,
                 {{{x + side, -0.2F, bottom}, 0.02F},
                  {{x + side, -0.2F, 0.5F * bottom}, 0.02F},
                  {{x + side, -0.2F, 0.3F}, 0.02F}},
                 8, {.material = Material::steel, .object = 80});
  }
  for (float z = bottom; z < -0.1F; z += 0.3F) {
    shapes::tube(
        mesh,
        {{{x - 0.2F, -0.2F, z}, 0.016F}, {{x, -0.2F, z}, 0.016F}, {{x + 0.2F, -0.2F, z}, 0.016F}},
        8, {.material = Material::steel, .object = 81});
    if (static_cast<int>(-z / 0.3F) % 5 == 0)
      add_box(mesh, {x - 0.24F, -0.22F, z - 0.03F}, {x - 0.16F, 0.02F, z + 0.03F}, Material::steel,
              82, 0.05F);
  }
}

void add_pipe(TriangleMesh& mesh, float x, float bottom) {
  std::vector<shapes::Ring> rings;
  for (float z = bottom; z < 0.2F; z += 0.1F) {
    const bool flange = std::abs(std::remainder(z, 2.0F)) < 0.06F;
    rings.push_back({{x, -0.26F, z}, flange ? 0.19F : 0.14F, flange ? 0.3F : 1.0F});
  }
  shapes::tube(mesh, rings, 22, {.material = Material::steel, .object = 83});
  for (float z = bottom + 1.0F; z < 0.0F; z += 2.0F)
    add_box(mesh, {x - 0.2F, -0.3F, z - 0.04F}, {x + 0.2F, 0.02F, z + 0.04F}, Material::steel, 84,
            0.05F);
}

void add_rubble(TriangleMesh& mesh, const WorldConfig& config, float floor, Random& random) {
  const int count = static_cast<int>(7.0 * config.size_m * config.rocks);
  for (int i = 0; i < count; ++i) {
    const float away = 0.1F + 2.6F * static_cast<float>(std::pow(random.uniform(), 2.0));
    const float size = 0.06F + 0.38F * static_cast<float>(std::pow(random.uniform(), 4.0));
    const Vector3f at(uniform(random, -0.5, 0.5) * static_cast<float>(config.size_m), -away,
                      floor + 0.3F * size);
    const auto object = static_cast<std::uint16_t>(random.next() >> 48);
    add_boulder(mesh, at, size, random, object,
                random.uniform() < 0.4 ? Material::concrete : Material::rock);
  }
}

}  // namespace

void add_dam(TriangleMesh& mesh, const WorldConfig& config, Random random) {
  const Layout layout = make_layout(config);
  const std::size_t first = mesh.triangles.size();
  add_face(mesh, config, layout);
  const std::size_t last = mesh.triangles.size();
  add_gate(mesh, layout.gate);
  add_intake(mesh, layout.intake, random);
  add_ladder(mesh, 0.4F, layout.floor + 0.6F);
  add_pipe(mesh, 12.5F, layout.floor - 0.2F);
  add_pipe(mesh, -13.0F, layout.floor - 0.2F);
  add_rubble(mesh, config, layout.floor, random);
  add_surface_growth(mesh, first, last, static_cast<int>(260.0 * config.marine_life),
                     0.16F * static_cast<float>(config.growth), random.fork(1));
}

}  // namespace apvi::sim::parts
