// SPDX-License-Identifier: BSD-3-Clause
// Boulders, corals, sponges and weed.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/world/noise_texture.hpp"
#include "sim/world/shapes.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim::parts {
namespace {

constexpr float kTwoPi = 2.0F * std::numbers::pi_v<float>;

Vector3f random_direction(Random& random, float up) {
  const float angle = uniform(random, 0.0, 2.0 * std::numbers::pi);
  return Vector3f(std::cos(angle), std::sin(angle), up).normalized();
}

struct Branch {
  Vector3f from, direction;
  float length, radius;
  int depth;
};

void grow_branch(TriangleMesh& mesh, const Affine3f& T, const Branch& b, Random& random,
                 const shapes::Skin& skin) {
  const Vector3f bend = 0.3F * b.length * random_direction(random, 0.8F);
  const bool tip = b.depth == 0;
  std::vector<shapes::Ring> rings;
  for (int i = 0; i <= 3; ++i) {
    const float u = static_cast<float>(i) / 3.0F;
    const Vector3f p = b.from + u * b.length * b.direction + u * u * bend;
    const float taper = b.radius * (1.0F - (tip ? 0.5F : 0.3F) * u);
    rings.push_back({T * p, taper,
                     std::min(1.0F, 0.3F + 0.35F * static_cast<float>(2 - b.depth) +
                                        (tip ? 0.35F * u * u * u : 0.0F))});
  }
  const Vector3f end = b.from + b.length * b.direction + bend;
  shapes::tube(mesh, rings, 6, skin, true);
  if (b.depth == 0) return;
  const int children = 2 + static_cast<int>(random.uniform() * 2.0);
  for (int k = 0; k < children; ++k) {
    const Vector3f turn = random_direction(random, 0.55F);
    grow_branch(mesh, T,
                {.from = end - 0.1F * static_cast<float>(k) * b.length * b.direction,
                 .direction = (0.55F * b.direction + 0.75F * turn).normalized(),
                 .length = b.length * uniform(random, 0.6, 0.9),
                 .radius = 0.72F * b.radius,
                 .depth = b.depth - 1},
                random, skin);
  }
}

void add_plate(TriangleMesh& mesh, const Affine3f& T, float radius, std::uint32_t key,
               const shapes::Skin& skin) {
  constexpr int kRings = 7;
  constexpr int kSides = 30;
  const auto point = [&](int side, int ring, float lift) {
    const float angle = kTwoPi * static_cast<float>(side) / kSides;
    const float u = static_cast<float>(ring) / kRings;
    const float lobe = fbm({std::cos(angle), std::sin(angle), 0.0F},
                           {.frequency = 1.4F, .octaves = 3, .gain = 0.5F, .seed = key});
    const float r = radius * u * (1.0F + 0.5F * lobe);
    const float z = 0.25F * radius * u * u + 0.12F * radius * lobe * u + lift * (1.0F - 0.8F * u);
    return shapes::GridPoint{T * Vector3f(r * std::cos(angle), r * std::sin(angle), z),
                             0.4F + 0.6F * u};
  };
  shapes::grid(mesh, kSides, kRings, skin,
               [&](int i, int j) { return point(i % kSides, kRings - j, 0.035F); });
  shapes::grid(mesh, kSides, kRings, skin,
               [&](int i, int j) { return point(i % kSides, j, -0.035F); });
}

}  // namespace

void add_boulder(TriangleMesh& mesh, const Vector3f& at, float radius, Random& random,
                 std::uint16_t object, Material material) {
  const Vector3f stretch(uniform(random, 0.75, 1.3), uniform(random, 0.75, 1.3),
                         uniform(random, 0.5, 0.95));
  const Vector3f offset(uniform(random, 0, 99), uniform(random, 0, 99), uniform(random, 0, 99));
  const int level = radius > 0.45F ? 5 : (radius > 0.2F ? 4 : (radius > 0.09F ? 3 : 2));
  const Vector3f cut = random_direction(random, 0.4F);
  shapes::deformed_sphere(
      mesh, level, {.material = material, .object = object}, [&](const Vector3f& p) {
        const float lumps =
            fbm(p + offset, {.frequency = 0.9F, .octaves = 5, .gain = 0.5F, .seed = 201});
        const float r = 1.0F + 0.75F * lumps;
        Vector3f q = r * p;
        const float beyond = q.dot(cut) - 0.55F;  // fracture plane
        if (beyond > 0.0F) q -= 0.85F * beyond * cut;
        return Vector3f(at + radius * stretch.cwiseProduct(q));
      });
}

void add_brain_coral(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object) {
  const Vector3f offset(uniform(random, 0, 99), uniform(random, 0, 99), 0.0F);
  const float flat = uniform(random, 0.6, 0.95);
  shapes::deformed_sphere(
      mesh, size > 0.2F ? 4 : 3, {.material = Material::brain_coral, .object = object},
      [&](const Vector3f& p) {
        const float lumps =
            fbm(p + offset, {.frequency = 1.0F, .octaves = 3, .gain = 0.45F, .seed = 211});
        const Vector3f q = (1.0F + 0.35F * lumps) * p;
        return Vector3f(
            T * Vector3f(0.5F * size * q.x(), 0.5F * size * q.y(), 0.5F * size * flat * q.z()));
      });
}

void add_branch_coral(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                      std::uint16_t object) {
  const int stems = 4 + static_cast<int>(random.uniform() * 5.0);
  for (int k = 0; k < stems; ++k) {
    const Vector3f out = random_direction(random, 0.9F);
    grow_branch(mesh, T,
                {.from = Vector3f(0.12F * size * out.x(), 0.12F * size * out.y(), -0.03F),
                 .direction = out,
                 .length = size * uniform(random, 0.3, 0.45),
                 .radius = size * uniform(random, 0.035, 0.055),
                 .depth = 2},
                random, {.material = Material::branch_coral, .object = object});
  }
}

void add_plate_coral(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object) {
  const int tiers = 1 + static_cast<int>(random.uniform() * 3.0);
  for (int k = 0; k < tiers; ++k) {
    const float weight = 1.0F - 0.22F * static_cast<float>(k);
    Affine3f tier = T;
    tier.translate(Vector3f(uniform(random, -0.1, 0.1) * size, uniform(random, -0.1, 0.1) * size,
                            size * (0.14F + 0.17F * static_cast<float>(k))));
    tier.rotate(Eigen::AngleAxisf(uniform(random, -0.2, 0.2), Vector3f::UnitX()));
    add_plate(mesh, tier, 0.55F * size * weight, static_cast<std::uint32_t>(random.next()),
              {.material = Material::plate_coral, .object = object});
  }
  shapes::tube(mesh,
               {{T * Vector3f(0, 0, -0.1F), 0.12F * size, 0.1F},
                {T * Vector3f(0, 0, 0.15F * size), 0.09F * size, 0.3F},
                {T * Vector3f(0, 0, 0.16F * size * static_cast<float>(tiers)), 0.07F * size, 0.5F}},
               10, {.material = Material::plate_coral, .object = object});
}

void add_tube_sponge(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object) {
  const int tubes = 2 + static_cast<int>(random.uniform() * 5.0);
  for (int k = 0; k < tubes; ++k) {
    const float height = size * uniform(random, 0.4, 1.0);
    const float r = size * uniform(random, 0.09, 0.16);
    Affine3f place = T;
    place.translate(
        Vector3f(uniform(random, -0.22, 0.22) * size, uniform(random, -0.22, 0.22) * size, -0.03F));
    place.rotate(Eigen::AngleAxisf(uniform(random, -0.3, 0.3), random_direction(random, 0.0F)));
    shapes::lathe(mesh, place,
                  {{{0, 0, 0}, 0.7F * r},
                   {{0, 0, 0.25F * height}, 0.85F * r},
                   {{0, 0, 0.6F * height}, 1.05F * r},
                   {{0, 0, 0.9F * height}, 1.1F * r},
                   {{0, 0, height}, r},
                   {{0, 0, 0.99F * height}, 0.75F * r},
                   {{0, 0, 0.8F * height}, 0.6F * r},
                   {{0, 0, 0.5F * height}, 0.4F * r},
                   {{0, 0, 0.45F * height}, 0.01F}},
                  18, {.material = Material::sponge, .object = object}, 0.03F);
  }
}

void add_fan(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
             std::uint16_t object) {
  constexpr int kColumns = 22;
  constexpr int kRows = 18;
  const auto key = static_cast<std::uint32_t>(random.next());
  const float curl = uniform(random, -0.3, 0.3);
  const auto spread = [&](int i) { return 2.6F * (static_cast<float>(i) / kColumns - 0.5F); };
  const auto rim = [&](int i) {
    return size *
           (0.85F + 0.5F * fbm({spread(i), 0, 0},
                               {.frequency = 2.0F, .octaves = 3, .gain = 0.6F, .seed = key}));
  };
  shapes::grid(mesh, kColumns, kRows, {.material = Material::fan_coral, .object = object},
               [&](int i, int j) {
                 const float r = 0.04F * size + rim(i) * static_cast<float>(j) / kRows;
                 const float x = r * std::sin(0.5F * spread(i));
                 const float random_gap =
                     unit_float(hash32(key, static_cast<std::uint32_t>(64 * i + j))) - 0.13F;
                 return shapes::GridPoint{
                     T * Vector3f(x, curl * x * x / size, r * std::cos(0.5F * spread(i)) - 0.03F),
                     1.0F, j < 5 ? 1.0F : random_gap};
               });
}

void add_weed(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
              std::uint16_t object) {
  const int blades = 8 + static_cast<int>(random.uniform() * 14.0);
  const Vector3f sway = random_direction(random, 0.0F);
  for (int k = 0; k < blades; ++k) {
    const Vector3f foot(uniform(random, -0.25, 0.25) * size, uniform(random, -0.25, 0.25) * size,
                        -0.02F);
    const float height = size * uniform(random, 0.5, 1.0);
    const float width = uniform(random, 0.008, 0.022);
    const Vector3f side = random_direction(random, 0.0F);
    const Vector3f lean = sway * uniform(random, 0.1, 0.7) + side * uniform(random, -0.2, 0.2);
    shapes::grid(mesh, 1, 8, {.material = Material::weed, .object = object}, [&](int i, int j) {
      const float u = static_cast<float>(j) / 8.0F;
      const float half = width * (1.0F - 0.8F * u * u) * (i == 0 ? -1.0F : 1.0F);
      const float wave = 0.04F * height * std::sin(9.0F * u + static_cast<float>(k));
      const Vector3f p = foot + Vector3f(0, 0, height * u * (1.0F - 0.25F * u)) +
                         lean * height * u * u + side * half + sway * wave;
      return shapes::GridPoint{T * p, u};
    });
  }
}

void add_marine_life(TriangleMesh& mesh, const Affine3f& T, float size, Random& random,
                     std::uint16_t object, Ground ground) {
  const double kind = random.uniform();
  const bool bed = ground == Ground::bed;
  if (kind < (bed ? 0.24 : 0.10)) return add_brain_coral(mesh, T, size, random, object);
  if (kind < (bed ? 0.46 : 0.30)) return add_branch_coral(mesh, T, size, random, object);
  if (kind < (bed ? 0.58 : 0.30)) return add_plate_coral(mesh, T, 1.2F * size, random, object);
  if (kind < (bed ? 0.74 : 0.60)) return add_tube_sponge(mesh, T, size, random, object);
  if (kind < (bed ? 0.84 : 0.75)) return add_fan(mesh, T, size, random, object);
  return add_weed(mesh, T, 1.2F * size, random, object);
}

}  // namespace apvi::sim::parts
