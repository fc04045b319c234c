// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "sim/writers/formats.hpp"

namespace apvi::sim {
namespace {

using Json = nlohmann::ordered_json;

Json triple(const Eigen::Vector3f& v) {
  return {v.x(), v.y(), v.z()};
}

void add_box(Json& entry, const Eigen::AlignedBox3f& box) {
  entry["center"] = triple(box.center());
  entry["min"] = triple(box.min());
  entry["max"] = triple(box.max());
}

// Of the whole disc, with the heights of all that is there.
Eigen::AlignedBox3f box_of(const RecoloredDisc& disc, const TriangleMesh& world) {
  const Eigen::Vector2f center(static_cast<float>(disc.x_m), static_cast<float>(disc.y_m));
  const auto radius = static_cast<float>(disc.radius_m);
  Eigen::AlignedBox3f inside;
  float nearest = std::numeric_limits<float>::max();
  float bed = 0.0F;  // at the vertex nearest to the center
  for (const Eigen::Vector3f& v : world.vertices) {
    const float distance = (v.head<2>() - center).norm();
    if (distance <= radius) inside.extend(v);
    if (distance < nearest) bed = v.z();
    nearest = std::min(nearest, distance);
  }
  const Eigen::Vector2f z = inside.isEmpty() ? Eigen::Vector2f(bed, bed)
                                             : Eigen::Vector2f(inside.min().z(), inside.max().z());
  const Eigen::Vector3f lower(center.x() - radius, center.y() - radius, z[0]);
  const Eigen::Vector3f upper(center.x() + radius, center.y() + radius, z[1]);
  return {lower, upper};
}

Json entry_of(const ObjectConfig& object, const TriangleMesh& mesh) {
  Json entry = {{"name", object.name},
                {"shape", to_string(object.shape)},
                {"size_m", object.size_m},
                {"turn_deg", object.turn_deg},
                {"seed", object.seed}};
  add_box(entry, mesh.bounds());
  return entry;
}

Json entry_of(const RecoloredDisc& disc, const TriangleMesh& world) {
  Json entry = {{"name", disc.name},
                {"radius_m", disc.radius_m},
                {"color", disc.color},
                {"amount", disc.amount}};
  add_box(entry, box_of(disc, world));
  return entry;
}

}  // namespace

std::string objects_json(const WorldConfig& world, std::uint64_t seed, const TriangleMesh& mesh) {
  Json json = {{"growth", world.growth}, {"objects", Json::array()}, {"recolored", Json::array()}};
  const std::vector<TriangleMesh> meshes = make_objects(world, seed);
  for (std::size_t i = 0; i < meshes.size(); ++i) {
    json["objects"].push_back(entry_of(world.objects[i], meshes[i]));
  }
  for (const RecoloredDisc& disc : world.recolored) {
    json["recolored"].push_back(entry_of(disc, mesh));
  }
  return json.dump(2) + "\n";
}

}  // namespace apvi::sim
