// SPDX-License-Identifier: BSD-3-Clause
// Wreck of a small steel coaster on the bed: 18 m long, keel along x, bow toward +x.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/world/noise_texture.hpp"
#include "sim/world/shapes.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim::parts {
namespace {

using shapes::GridPoint;
using shapes::Skin;

constexpr float kLength = 18.0F;
constexpr float kBeam = 4.6F;
constexpr float kDeck = 2.6F;      // above the keel amidships [m]
constexpr float kBulwark = 0.55F;  // above the deck [m]
constexpr float kFrames = 0.6F;    // spacing of ribs [m]

// s runs from the stern (0) to the bow (1).
float half_breadth(float s) {
  const float bow = s > 0.55F ? (s - 0.55F) / 0.45F : 0.0F;
  const float stern = s < 0.2F ? (0.2F - s) / 0.2F : 0.0F;
  return 0.5F * kBeam * std::sqrt(std::max(0.0F, 1.0F - std::pow(bow, 2.4F))) *
         (1.0F - 0.35F * stern * stern);
}

float sheer(float s) {
  const float d = s - 0.45F;
  return kDeck + (d > 0.0F ? 3.2F : 1.2F) * d * d;
}

// Point of the shell: t from the keel (0) to the top of the bulwark (1), `side` +1 to port.
Vector3f hull_point(float s, float t, float side, float inset) {
  const float top = sheer(s) + kBulwark;
  const float v_shape = s > 0.6F ? (s - 0.6F) / 0.4F : 0.0F;  // round amidships, sharp at the bow
  const float power = 0.22F + 0.5F * v_shape;
  const float breadth =
      std::max(0.02F, half_breadth(s) * (0.72F * std::pow(t, power) + 0.28F * t) - inset);
  const float rake = 1.0F * v_shape * v_shape * t;
  return {kLength * (s - 0.5F) + rake, side * breadth,
          top * t + 0.9F * v_shape * v_shape * (1.0F - t) * (1.0F - t)};
}

// Negative where the shell has rusted through, and in the gash in its starboard side.
float soundness(float s, float t, float side) {
  const Vector3f p = hull_point(s, t, side, 0.0F);
  const float rot = fbm(p, {.frequency = 0.8F, .octaves = 6, .gain = 0.55F, .seed = 401});
  const float x = (s - 0.42F) / 0.13F;
  const float z = (t - 0.42F) / 0.30F;
  const float gash = side < 0.0F ? x * x + z * z + 1.6F * rot - 0.9F : 1.0F;
  return std::min(gash, 0.40F - 0.08F * t - rot);
}

float seam_detail(float s, float t) {
  const float along = std::abs(std::remainder(kLength * s, 1.8F));
  const float girth = std::abs(std::remainder(t * 7.0F, 1.0F)) / 7.0F * 3.6F;
  return smooth_step(0.0F, 0.09F, std::min(along, girth));
}

void add_shell(TriangleMesh& mesh, float side, float inset) {
  constexpr int kColumns = 330;
  constexpr int kRows = 72;
  const Skin skin{.material = Material::steel,
                  .object = static_cast<std::uint16_t>(side > 0 ? 7 : 8)};
  const bool outer = inset == 0.0F;
  const auto s_of = [](int i) { return static_cast<float>(i) / kColumns; };
  const auto t_of = [](int j) { return static_cast<float>(j) / kRows; };
  // Triangles face outward on the outer shell and inward on the inner one.
  const bool mirrored = (side > 0.0F) == outer;
  shapes::grid(mesh, kColumns, kRows, skin, [&](int i, int j) {
    const float s = s_of(mirrored ? kColumns - i : i);
    const float t = t_of(j);
    const float strake = std::floor(t * 7.0F);
    const float lap = static_cast<int>(strake) % 2 == 0 ? 0.018F : 0.0F;
    const float dent = 0.05F * fbm(hull_point(s, t, side, 0),
                                   {.frequency = 0.7F, .octaves = 3, .gain = 0.5F, .seed = 402});
    // Plates sag between the frames.
    const float sag = 0.012F * std::cos(2.0F * std::numbers::pi_v<float> * kLength * s / kFrames);
    return GridPoint{hull_point(s, t, side, inset + lap + dent + sag), seam_detail(s, t),
                     soundness(s, t, side)};
  });
}

// The stem, where the two sides meet at the bow, and the transom that closes the stern.
void add_ends(TriangleMesh& mesh) {
  std::vector<shapes::Ring> stem;
  for (int j = 0; j <= 40; ++j) {
    const float t = static_cast<float>(j) / 40.0F;
    const Vector3f p = hull_point(1.0F, t, 1.0F, 0.0F);
    stem.push_back({{p.x(), 0.0F, p.z()}, 0.09F + 0.03F * t});
  }
  shapes::tube(mesh, stem, 10, {.material = Material::steel, .object = 8});
  constexpr int kColumns = 80;
  constexpr int kRows = 60;
  shapes::grid(mesh, kColumns, kRows, {.material = Material::steel, .object = 8}, [](int i, int j) {
    const float u = static_cast<float>(i) / kColumns;
    const float t = static_cast<float>(j) / kRows;
    const Vector3f port = hull_point(0.0F, t, 1.0F, 0.0F);
    const Vector3f p = port + u * Vector3f(0.0F, -2.0F * port.y(), 0.0F) -
                       Vector3f(0.25F * std::sin(3.14159F * u), 0.0F, 0.0F);
    const float rot = fbm(p, {.frequency = 0.8F, .octaves = 6, .gain = 0.55F, .seed = 401});
    const float seam = std::abs(std::remainder(t * 5.0F, 1.0F)) / 5.0F * 3.0F;
    return GridPoint{p, smooth_step(0.0F, 0.09F, seam), 0.3F - rot};
  });
}

void add_ribs(TriangleMesh& mesh) {
  const int count = static_cast<int>(kLength / kFrames);
  for (int k = 1; k < count; ++k) {
    const float s = static_cast<float>(k) / static_cast<float>(count);
    for (const float side : {-1.0F, 1.0F}) {
      std::vector<shapes::Ring> rings;
      for (int j = 0; j <= 26; ++j) {
        const float t = static_cast<float>(j) / 26.0F * 0.97F;
        rings.push_back({hull_point(s, t, side, 0.12F), 0.045F});
      }
      shapes::tube(mesh, rings, 6, {.material = Material::steel, .object = 9});
    }
  }
}

void add_deck(TriangleMesh& mesh, Random& random) {
  constexpr float kPlank = 0.16F;
  for (float y = -0.5F * kBeam; y < 0.5F * kBeam; y += kPlank) {
    for (float x = -8.6F; x < 8.2F;) {
      const float length = uniform(random, 1.2, 2.8);
      const float s = (x + 0.5F * length) / kLength + 0.5F;
      const bool inside = std::abs(y) + kPlank < half_breadth(s) - 0.1F && s < 0.95F;
      const bool hatch = x + length > -2.4F && x < 1.6F && std::abs(y) < 1.15F;
      if (inside && !hatch && random.uniform() > 0.13) {
        Affine3f T = Affine3f::Identity();
        T.translation() = Vector3f(x + 0.5F * length, y + 0.5F * kPlank,
                                   sheer(s) + uniform(random, -0.012, 0.012));
        T.rotate(Eigen::AngleAxisf(-(sheer(s + 0.03F) - sheer(s - 0.03F)) / (0.06F * kLength),
                                   Vector3f::UnitY()));
        if (random.uniform() < 0.06)
          T.rotate(Eigen::AngleAxisf(uniform(random, -0.25, 0.25), Vector3f::UnitZ()));
        shapes::box(
            mesh, T, {0.49F * length, 0.5F * kPlank - 0.006F, 0.025F},
            {.material = Material::wood, .object = static_cast<std::uint16_t>(random.next() >> 48)},
            0.1F);
      }
      x += length;
    }
  }
}

void add_box(TriangleMesh& mesh, const Vector3f& center, const Vector3f& half, Material material,
             std::uint16_t object, float tilt = 0.0F, float cell = 0.12F) {
  Affine3f T = Affine3f::Identity();
  T.translation() = center;
  T.rotate(Eigen::AngleAxisf(tilt, Vector3f::UnitX()));
  shapes::box(mesh, T, half, {.material = material, .object = object}, cell);
}

// A plate wall with openings, from `foot` along `u`.
void add_wall(TriangleMesh& mesh, const Vector3f& foot, const Vector3f& u, float height,
              int windows, std::uint16_t object) {
  const float width = u.norm();
  const int columns = static_cast<int>(width / 0.06F);
  const int rows = static_cast<int>(height / 0.06F);
  // Negative in the windows and where the plate has rusted through.
  const auto soundness_at = [&](float along, float z) {
    const float x = along * static_cast<float>(windows);
    const float beside = (std::abs(x - std::floor(x) - 0.5F) - 0.3F) * width /
                         std::max(1.0F, static_cast<float>(windows));
    const float window = windows > 0 ? std::max(beside, std::abs(z - 1.42F) - 0.33F) : 1.0F;
    const Vector3f p = foot + u * along + Vector3f(0, 0, z);
    return std::min(window,
                    0.36F - fbm(p, {.frequency = 1.1F, .octaves = 5, .gain = 0.55F, .seed = 403}));
  };
  for (const float side : {0.0F, 0.03F}) {
    const Vector3f normal = u.cross(Vector3f::UnitZ()).normalized();
    shapes::grid(mesh, columns, rows, {.material = Material::steel, .object = object},
                 [&](int i, int j) {
                   const float a = static_cast<float>(i) / static_cast<float>(columns);
                   const float z = height * static_cast<float>(j) / static_cast<float>(rows);
                   const bool edge = j == 0 || j == rows || i == 0 || i == columns;
                   return GridPoint{foot + u * a + Vector3f(0, 0, z) - side * normal,
                                    edge ? 0.3F : 1.0F, soundness_at(a, z)};
                 });
  }
}

void add_wheelhouse(TriangleMesh& mesh) {
  const float z = sheer(0.16F) + 0.02F;
  const float x0 = -7.6F;
  const float x1 = -4.6F;
  const float y = 1.25F;
  add_wall(mesh, {x0, -y, z}, {x1 - x0, 0, 0}, 2.2F, 3, 20);
  add_wall(mesh, {x1, -y, z}, {0, 2 * y, 0}, 2.2F, 3, 20);
  add_wall(mesh, {x1, y, z}, {x0 - x1, 0, 0}, 2.2F, 3, 20);
  add_wall(mesh, {x0, y, z}, {0, -2 * y, 0}, 2.2F, 2, 20);
  add_box(mesh, {0.5F * (x0 + x1), 0, z + 2.23F}, {0.5F * (x1 - x0) + 0.2F, y + 0.2F, 0.04F},
          Material::steel, 21);
  shapes::tube(mesh,
               {{{x0 - 0.6F, 0, z}, 0.32F},
                {{x0 - 0.6F, 0, z + 0.7F}, 0.32F},
                {{x0 - 0.65F, 0, z + 1.5F}, 0.31F},
                {{x0 - 0.7F, 0.02F, z + 2.0F}, 0.33F, 0.2F}},
               22, {.material = Material::steel, .object = 22}, false);
}

void add_pole(TriangleMesh& mesh, const Vector3f& from, const Vector3f& to, float radius,
              std::uint16_t object) {
  std::vector<shapes::Ring> rings;
  for (int k = 0; k <= 20; ++k) {
    const float u = static_cast<float>(k) / 20.0F;
    rings.push_back({from + u * (to - from), radius * (1.0F - 0.25F * u)});
  }
  shapes::tube(mesh, rings, 12, {.material = Material::steel, .object = object});
}

void add_railing(TriangleMesh& mesh, float side) {
  std::vector<shapes::Ring> rail;
  for (float s = 0.32F; s < 0.9F; s += 0.02F) {
    const Vector3f foot = hull_point(s, 1.0F, side, 0.03F);
    rail.push_back({foot + Vector3f(0, 0, 0.45F), 0.022F});
    if (static_cast<int>(s * 50.0F) % 2 == 0)
      add_pole(mesh, foot, foot + Vector3f(0, 0, 0.45F), 0.02F, 23);
  }
  shapes::tube(mesh, rail, 7, {.material = Material::steel, .object = 23});
}

void add_deck_gear(TriangleMesh& mesh, Random& random) {
  const float z = sheer(0.45F);
  for (const float side : {-1.0F, 1.0F}) {  // coaming of the hatch
    add_box(mesh, {-0.4F, side * 1.2F, z + 0.2F}, {2.05F, 0.05F, 0.28F}, Material::steel, 24);
    add_railing(mesh, side);
    add_box(mesh, {7.0F, side * 0.7F, sheer(0.9F) + 0.2F}, {0.07F, 0.07F, 0.22F}, Material::steel,
            25, 0, 0.05F);
  }
  add_box(mesh, {-2.45F, 0, z + 0.2F}, {0.05F, 1.2F, 0.28F}, Material::steel, 24);
  add_box(mesh, {1.65F, 0, z + 0.2F}, {0.05F, 1.2F, 0.28F}, Material::steel, 24);
  // Windlass on the foredeck: a drum between two cheeks.
  const float fore = sheer(0.82F);
  add_pole(mesh, {5.6F, -0.8F, fore + 0.45F}, {5.6F, 0.8F, fore + 0.45F}, 0.26F, 26);
  add_box(mesh, {5.6F, -0.55F, fore + 0.3F}, {0.4F, 0.05F, 0.4F}, Material::steel, 26);
  add_box(mesh, {5.6F, 0.55F, fore + 0.3F}, {0.4F, 0.05F, 0.4F}, Material::steel, 26);
  // Broken mast: the stump stands, the rest lies over the side.
  add_pole(mesh, {3.1F, 0, z + 0.1F}, {3.1F, 0.05F, z + 1.3F}, 0.16F, 27);
  add_pole(mesh, {2.9F, 0.4F, z + 0.7F}, {1.2F, -6.2F, -0.1F}, 0.15F, 27);
  add_pole(mesh, {2.2F, -1.4F, z + 0.3F}, {-3.4F, -3.6F, 0.4F}, 0.07F, 28);
  for (int k = 0; k < 6; ++k) {  // cargo on the bed below the gash
    add_box(mesh,
            {uniform(random, -4.5, 1.0), uniform(random, -5.6, -3.0), uniform(random, 0.45, 0.6)},
            {uniform(random, 0.2, 0.5), uniform(random, 0.2, 0.35), uniform(random, 0.12, 0.3)},
            random.uniform() < 0.5 ? Material::wood : Material::steel,
            static_cast<std::uint16_t>(30 + k), uniform(random, -0.5, 0.5), 0.06F);
  }
}

}  // namespace

void add_wreck(TriangleMesh& mesh, const WorldConfig& config, const Terrain& terrain,
               Random random) {
  TriangleMesh ship;
  for (const float side : {-1.0F, 1.0F}) {
    add_shell(ship, side, 0.0F);
    add_shell(ship, side, 0.05F);
  }
  add_ends(ship);
  const std::size_t shell_end = ship.triangles.size();
  add_ribs(ship);
  const std::size_t deck_start = ship.triangles.size();
  add_deck(ship, random);
  add_wheelhouse(ship);
  add_deck_gear(ship, random);
  const std::size_t deck_end = ship.triangles.size();
  const int count = static_cast<int>(420.0 * config.marine_life);
  const auto growth = static_cast<float>(config.growth);
  add_surface_growth(ship, 0, shell_end, count, 0.28F * growth, random.fork(1));
  add_surface_growth(ship, deck_start, deck_end, count, 0.24F * growth, random.fork(2));
  Affine3f T = Affine3f::Identity();
  T.translation() = Vector3f(0, 0, terrain.height(0, 0) - 0.75F);
  T.rotate(Eigen::AngleAxisf(0.16F, Vector3f::UnitX()));
  T.rotate(Eigen::AngleAxisf(-0.03F, Vector3f::UnitY()));
  mesh.append(ship, T);
}

}  // namespace apvi::sim::parts
