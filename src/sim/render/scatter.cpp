// SPDX-License-Identifier: BSD-3-Clause
// Random placement of objects: clustered, denser on rocky ground.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/world/shapes.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim::parts {
namespace {

int count_for(const WorldConfig& config, double per_square_meter) {
  return static_cast<int>(per_square_meter * config.size_m * config.size_m);
}

// Whether objects may be placed here: not behind the dam, not inside the wreck.
bool is_free(const WorldConfig& config, float x, float y) {
  if (config.kind == WorldKind::dam) return y < -0.4F;
  if (config.kind == WorldKind::ship) return std::abs(x) > 9.5F || std::abs(y) > 2.6F;
  return true;
}

struct Spot {
  float x, y;
};

Spot random_spot(const WorldConfig& config, Random& random) {
  const double half = 0.5 * config.size_m;
  return {uniform(random, -half, half), uniform(random, -half, half)};
}

Affine3f upright(const Terrain& terrain, const Spot& spot, Random& random) {
  Affine3f T = Affine3f::Identity();
  T.translation() = Vector3f(spot.x, spot.y, terrain.height(spot.x, spot.y));
  T.rotate(Eigen::AngleAxisf(uniform(random, 0, 6.28), Vector3f::UnitZ()));
  T.rotate(Eigen::AngleAxisf(uniform(random, -0.2, 0.2), Vector3f::UnitX()));
  return T;
}

std::uint16_t object_number(Random& random) {
  return static_cast<std::uint16_t>(random.next() >> 48);
}

}  // namespace

void scatter_rocks(TriangleMesh& mesh, const Terrain& terrain, const WorldConfig& config,
                   Random random) {
  const int count = count_for(config, 0.9 * config.rocks);
  for (int i = 0; i < count; ++i) {
    const Spot spot = random_spot(config, random);
    const double u = random.uniform();
    const float radius =
        0.03F + 0.75F * static_cast<float>(std::pow(u, 9.0)) + 0.10F * static_cast<float>(u * u);
    const float welcome = 0.35F + 0.65F * terrain.reef(spot.x, spot.y);
    const bool here =
        is_free(config, spot.x, spot.y) &&
        random.uniform() < static_cast<double>(welcome * terrain.richness(spot.x, spot.y));
    if (!here) continue;
    const float z = terrain.height(spot.x, spot.y) + radius * uniform(random, -0.1, 0.35);
    add_boulder(mesh, {spot.x, spot.y, z}, radius, random, object_number(random));
  }
}

void scatter_marine_life(TriangleMesh& mesh, const Terrain& terrain, const WorldConfig& config,
                         Random random) {
  const double density = config.kind == WorldKind::seabed ? 0.30 : 0.08;
  const int clusters = count_for(config, density * config.marine_life);
  for (int i = 0; i < clusters; ++i) {
    const Spot center = random_spot(config, random);
    const int members = 2 + static_cast<int>(random.uniform() * 8.0);
    const float keep =
        (0.3F + 0.7F * terrain.reef(center.x, center.y)) * terrain.richness(center.x, center.y);
    if (random.uniform() > static_cast<double>(keep)) continue;
    for (int k = 0; k < members; ++k) {
      const Spot spot{center.x + static_cast<float>(random.normal(0.0, 0.5)),
                      center.y + static_cast<float>(random.normal(0.0, 0.5))};
      const float usual = 0.12F + 0.5F * static_cast<float>(std::pow(random.uniform(), 2.5));
      const float size = usual * static_cast<float>(config.growth);
      if (!is_free(config, spot.x, spot.y) || terrain.richness(spot.x, spot.y) < 0.9F) continue;
      add_marine_life(mesh, upright(terrain, spot, random), size, random, object_number(random),
                      Ground::bed);
    }
  }
}

void scatter_debris(TriangleMesh& mesh, const Terrain& terrain, const WorldConfig& config,
                    Random random) {
  const int count = count_for(config, 0.02 * config.debris);
  for (int i = 0; i < count; ++i) {
    const Spot spot = random_spot(config, random);
    if (!is_free(config, spot.x, spot.y) || terrain.richness(spot.x, spot.y) < 0.9F) continue;
    add_debris(mesh, {spot.x, spot.y, terrain.height(spot.x, spot.y)}, random,
               object_number(random));
  }
}

void add_surface_growth(TriangleMesh& mesh, std::size_t first_triangle, std::size_t last_triangle,
                        int count, float size, Random random) {
  std::vector<double> area;  // cumulative, so that placement is uniform by area
  double total = 0.0;
  for (std::size_t i = first_triangle; i < last_triangle; ++i) {
    const TriangleMesh::Triangle& t = mesh.triangles[i];
    const Vector3f a = mesh.vertices[t[0]];
    total += static_cast<double>((mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a).norm());
    area.push_back(total);
  }
  for (int i = 0; i < count && total > 0.0; ++i) {
    const auto found = std::lower_bound(area.begin(), area.end(), random.uniform() * total);
    const auto index = std::min(area.size() - 1, static_cast<std::size_t>(found - area.begin()));
    const TriangleMesh::Triangle t = mesh.triangles[first_triangle + index];
    const Vector3f a = mesh.vertices[t[0]];
    const Vector3f normal = (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a).normalized();
    if (!normal.allFinite() || normal.z() < -0.3F) continue;
    const Vector3f direction = (normal + 0.5F * Vector3f::UnitZ()).normalized();
    const float s = size * (0.35F + 0.8F * static_cast<float>(std::pow(random.uniform(), 2.0)));
    add_marine_life(mesh, shapes::frame_along(a, direction, uniform(random, 0, 6.28)), s, random,
                    object_number(random), Ground::wall);
  }
}

void add_tire(TriangleMesh& mesh, const Affine3f& T, std::uint16_t object) {
  std::vector<shapes::Ring> loop;
  for (int k = 0; k <= 28; ++k) {
    const float angle = 2.0F * std::numbers::pi_v<float> * static_cast<float>(k) / 28.0F;
    loop.push_back({T * Vector3f(0.26F * std::cos(angle), 0.26F * std::sin(angle), 0.05F), 0.09F});
  }
  shapes::tube(mesh, loop, 12, {.material = Material::mussels, .object = object}, false);
}

void add_block(TriangleMesh& mesh, const Affine3f& T, std::uint16_t object) {
  shapes::box(mesh, T * Eigen::Translation3f(0, 0, 0.15F), {0.3F, 0.25F, 0.2F},
              {.material = Material::concrete, .object = object}, 0.05F);
}

void add_debris(TriangleMesh& mesh, const Vector3f& at, Random& random, std::uint16_t object) {
  const float heading = uniform(random, 0, 6.28);
  Affine3f T = Affine3f::Identity();
  T.translation() = at;
  T.rotate(Eigen::AngleAxisf(heading, Vector3f::UnitZ()));
  T.rotate(Eigen::AngleAxisf(uniform(random, -0.25, 0.25), Vector3f::UnitX()));
  const Vector3f along = T.linear() * Vector3f::UnitX();
  const double kind = random.uniform();
  if (kind < 0.2) {  // a tire
    add_tire(mesh, T, object);
  } else if (kind < 0.45) {  // a pipe
    const float length = uniform(random, 0.6, 2.5);
    const float radius = uniform(random, 0.03, 0.12);
    std::vector<shapes::Ring> rings;
    for (int k = 0; k <= 12; ++k)
      rings.push_back({at + Vector3f(0, 0, 0.5F * radius) +
                           along * length * (static_cast<float>(k) / 12.0F - 0.5F),
                       radius});
    shapes::tube(mesh, rings, 16, {.material = Material::steel, .object = object});
  } else if (kind < 0.65) {  // a plank
    shapes::box(mesh, T, {uniform(random, 0.4, 1.1), 0.09F, 0.025F},
                {.material = Material::wood, .object = object}, 0.08F);
  } else if (kind < 0.8) {  // a half-buried drum
    const Affine3f lying = shapes::frame_along(at - 0.4F * along + Vector3f(0, 0, 0.12F), along);
    shapes::lathe(mesh, lying,
                  {{{0, 0, 0}, 0.01F},
                   {{0, 0, 0}, 0.28F, 0.2F},
                   {{0, 0, 0.02F}, 0.29F, 0.2F},
                   {{0, 0, 0.27F}, 0.28F},
                   {{0, 0, 0.29F}, 0.295F, 0.4F},
                   {{0, 0, 0.31F}, 0.28F},
                   {{0, 0, 0.56F}, 0.28F},
                   {{0, 0, 0.58F}, 0.295F, 0.4F},
                   {{0, 0, 0.6F}, 0.28F},
                   {{0, 0, 0.85F}, 0.29F, 0.2F},
                   {{0, 0, 0.83F}, 0.01F}},
                  28, {.material = Material::steel, .object = object});
  } else if (kind < 0.9) {  // a jar on its side
    const Affine3f lying = shapes::frame_along(at - 0.3F * along + Vector3f(0, 0, 0.1F),
                                               along + Vector3f(0, 0, 0.15F));
    shapes::lathe(mesh, lying,
                  {{{0, 0, 0}, 0.01F},
                   {{0, 0, 0.02F}, 0.06F},
                   {{0, 0, 0.15F}, 0.13F},
                   {{0, 0, 0.35F}, 0.17F},
                   {{0, 0, 0.5F}, 0.14F},
                   {{0, 0, 0.56F}, 0.07F},
                   {{0, 0, 0.66F}, 0.055F},
                   {{0, 0, 0.68F}, 0.075F},
                   {{0, 0, 0.66F}, 0.04F},
                   {{0, 0, 0.55F}, 0.04F}},
                  26, {.material = Material::rock, .object = object});
  } else {  // a mooring block
    add_block(mesh, T, object);
  }
}

}  // namespace apvi::sim::parts
