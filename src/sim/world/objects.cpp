// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/objects.hpp"

#include <cmath>
#include <numbers>
#include <set>

#include "apvi/core/error.hpp"
#include "sim/world/world_parts.hpp"

namespace apvi::sim {
namespace {

constexpr float kSunk = 0.12F;  // part of the height that is below the bed
constexpr std::uint64_t kObjectsStream = 6;

using parts::Affine3f;
using parts::Vector3f;

// About the origin, of roughly the right size.
TriangleMesh shape_of(const ObjectConfig& config, Random random) {
  TriangleMesh mesh;
  const Affine3f T = Affine3f::Identity();
  const auto size = static_cast<float>(config.size_m);
  const auto number = static_cast<std::uint16_t>(random.next() >> 48);
  switch (config.shape) {
    case ObjectShape::boulder:
      parts::add_boulder(mesh, Vector3f::Zero(), 0.5F * size, random, number);
      break;
    case ObjectShape::brain_coral:
      parts::add_brain_coral(mesh, T, size, random, number);
      break;
    case ObjectShape::branch_coral:
      parts::add_branch_coral(mesh, T, size, random, number);
      break;
    case ObjectShape::plate_coral:
      parts::add_plate_coral(mesh, T, size, random, number);
      break;
    case ObjectShape::sponge:
      parts::add_tube_sponge(mesh, T, size, random, number);
      break;
    case ObjectShape::fan_coral:
      parts::add_fan(mesh, T, size, random, number);
      break;
    case ObjectShape::weed:
      parts::add_weed(mesh, T, size, random, number);
      break;
    case ObjectShape::tire:
      parts::add_tire(mesh, T, number);
      break;
    case ObjectShape::block:
      parts::add_block(mesh, T, number);
      break;
  }
  return mesh;
}

// From the frame of a shape to the world: of the given size, its lower end in the bed.
Affine3f placement(const ObjectConfig& config, const Eigen::AlignedBox3f& box,
                   const parts::Terrain& terrain) {
  const auto x = static_cast<float>(config.x_m);
  const auto y = static_cast<float>(config.y_m);
  const Vector3f foot(box.center().x(), box.center().y(), box.min().z() + kSunk * box.sizes().z());
  Affine3f T = Affine3f::Identity();
  T.translate(Vector3f(x, y, terrain.height(x, y)));
  T.rotate(Eigen::AngleAxisf(static_cast<float>(config.turn_deg * std::numbers::pi / 180.0),
                             Vector3f::UnitZ()));
  T.scale(static_cast<float>(config.size_m) / box.sizes().maxCoeff());
  T.translate(-foot);
  return T;
}

void check_place(const WorldConfig& world, std::string_view list, const std::string& name, double x,
                 double y) {
  const double half = 0.5 * world.size_m;
  if (std::abs(x) > half || std::abs(y) > half) {
    fail_input("world.{}: {} at x {} m, y {} m is outside of world.size_m ({} m)", list, name, x, y,
               world.size_m);
  }
}

}  // namespace

std::string_view to_string(ObjectShape shape) {
  switch (shape) {
    case ObjectShape::boulder:
      return "boulder";
    case ObjectShape::brain_coral:
      return "brain_coral";
    case ObjectShape::branch_coral:
      return "branch_coral";
    case ObjectShape::plate_coral:
      return "plate_coral";
    case ObjectShape::sponge:
      return "sponge";
    case ObjectShape::fan_coral:
      return "fan_coral";
    case ObjectShape::weed:
      return "weed";
    case ObjectShape::tire:
      return "tire";
    case ObjectShape::block:
      return "block";
  }
  return "";
}

void check_objects(const WorldConfig& world) {
  std::set<std::string> names;
  const auto check = [&](std::string_view list, const auto& item) {
    if (item.name.empty()) fail_input("world.{}: an entry has no name; give it one", list);
    if (!names.insert(item.name).second) {
      fail_input("world.{}: two entries are named {}; rename one", list, item.name);
    }
    check_place(world, list, item.name, item.x_m, item.y_m);
  };
  for (const ObjectConfig& object : world.objects) check("objects", object);
  for (const RecoloredDisc& disc : world.recolored) check("recolored", disc);
}

std::vector<TriangleMesh> make_objects(const WorldConfig& world, std::uint64_t seed) {
  const parts::Terrain terrain(world, seed);
  const Random random = Random(seed).fork(kObjectsStream);
  std::vector<TriangleMesh> meshes;
  for (const ObjectConfig& object : world.objects) {
    const TriangleMesh shape =
        shape_of(object, random.fork(static_cast<std::uint64_t>(object.seed)));
    meshes.emplace_back().append(shape, placement(object, shape.bounds(), terrain));
  }
  return meshes;
}

std::vector<Tint> make_tints(const WorldConfig& world) {
  std::vector<Tint> tints;
  for (const RecoloredDisc& disc : world.recolored) {
    tints.push_back({.x = static_cast<float>(disc.x_m),
                     .y = static_cast<float>(disc.y_m),
                     .radius = static_cast<float>(disc.radius_m),
                     .r = static_cast<float>(disc.color[0]),
                     .g = static_cast<float>(disc.color[1]),
                     .b = static_cast<float>(disc.color[2]),
                     .amount = static_cast<float>(disc.amount)});
  }
  return tints;
}

}  // namespace apvi::sim
