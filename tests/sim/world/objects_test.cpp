// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/objects.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "sim/world/world.hpp"
#include "sim/world/world_parts.hpp"
#include "sim/writers/formats.hpp"

namespace apvi::sim {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t kSeed = 5;

WorldConfig small_world() {
  return {.kind = WorldKind::seabed, .depth_m = 9.0, .size_m = 10.0, .resolution_m = 0.1};
}

WorldConfig with_object(const std::string& shape, double size_m) {
  WorldConfig world = small_world();
  ObjectConfig object;
  config::read(config::parse_yaml("shape: " + shape, "scene.yaml"), object);
  object.name = shape;
  object.x_m = 1.0;
  object.y_m = -2.0;
  object.size_m = size_m;
  world.objects = {object};
  return world;
}

std::string error_of(const WorldConfig& world) {
  try {
    check_objects(world);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

class EveryShape : public testing::TestWithParam<const char*> {};

TEST_P(EveryShape, StandsOnTheBedWithItsSize) {
  const WorldConfig world = with_object(GetParam(), 0.4);
  const Eigen::AlignedBox3f box = make_objects(world, kSeed).front().bounds();
  EXPECT_NEAR(box.sizes().maxCoeff(), 0.4, 1e-4);
  EXPECT_NEAR(box.center().x(), 1.0, 1e-4);
  EXPECT_NEAR(box.center().y(), -2.0, 1e-4);
  const float bed = parts::Terrain(world, kSeed).height(1.0F, -2.0F);
  EXPECT_NEAR((bed - box.min().z()) / box.sizes().z(), 0.12, 1e-3) << "the part below the bed";
}

TEST_P(EveryShape, LeavesTheRestOfTheMeshAsItIs) {
  const TriangleMesh without = make_world(small_world(), kSeed);
  const TriangleMesh with = make_world(with_object(GetParam(), 0.4), kSeed);
  const auto starts_with = [](const auto& longer, const auto& shorter) {
    return longer.size() > shorter.size() &&
           std::equal(shorter.begin(), shorter.end(), longer.begin());
  };
  EXPECT_TRUE(starts_with(with.vertices, without.vertices));
  EXPECT_TRUE(starts_with(with.triangles, without.triangles));
  EXPECT_TRUE(starts_with(with.objects, without.objects));
}

INSTANTIATE_TEST_SUITE_P(Objects, EveryShape,
                         testing::Values("boulder", "brain_coral", "branch_coral", "plate_coral",
                                         "sponge", "fan_coral", "weed", "tire", "block"));

TEST(Objects, DoNotDependOnOtherObjects) {
  WorldConfig world = with_object("sponge", 0.3);
  const TriangleMesh alone = make_objects(world, kSeed).front();
  world.objects.insert(world.objects.begin(), with_object("boulder", 0.5).objects.front());
  EXPECT_EQ(make_objects(world, kSeed).back().vertices, alone.vertices);
}

TEST(Objects, SeedChangesTheForm) {
  WorldConfig world = with_object("boulder", 0.3);
  const TriangleMesh before = make_objects(world, kSeed).front();
  world.objects.front().seed = 2;
  EXPECT_NE(make_objects(world, kSeed).front().vertices, before.vertices);
}

TEST(Objects, TurnIsAboutTheVertical) {
  WorldConfig world = with_object("block", 0.6);
  const Eigen::Vector3f before = make_objects(world, kSeed).front().bounds().sizes();
  world.objects.front().turn_deg = 90.0;
  const Eigen::Vector3f after = make_objects(world, kSeed).front().bounds().sizes();
  EXPECT_NEAR(after.x(), before.y(), 1e-4);
  EXPECT_NEAR(after.y(), before.x(), 1e-4);
  EXPECT_NEAR(after.z(), before.z(), 1e-4);
  EXPECT_GT(before.x(), before.y() + 0.05F);
}

TEST(Objects, TruthBoxContainsAllVertices) {
  const WorldConfig world = with_object("plate_coral", 0.4);
  const TriangleMesh mesh = make_world(world, kSeed);
  const auto json = nlohmann::json::parse(objects_json(world, kSeed, mesh));
  const auto& entry = json["objects"][0];
  EXPECT_EQ(entry["name"], "plate_coral");
  EXPECT_EQ(entry["shape"], "plate_coral");
  const auto count = make_objects(world, kSeed).front().vertices.size();
  for (std::size_t i = mesh.vertices.size() - count; i < mesh.vertices.size(); ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_GE(mesh.vertices[i][static_cast<Eigen::Index>(axis)], entry["min"][axis]);
      EXPECT_LE(mesh.vertices[i][static_cast<Eigen::Index>(axis)], entry["max"][axis]);
    }
  }
}

TEST(Objects, TruthBoxOfADiscHasTheHeightsInIt) {
  WorldConfig world = small_world();
  world.recolored = {{.name = "bleached", .x_m = 1.0, .y_m = 1.0, .radius_m = 0.5}};
  const TriangleMesh mesh = make_world(world, kSeed);
  const auto entry = nlohmann::json::parse(objects_json(world, kSeed, mesh))["recolored"][0];
  EXPECT_NEAR(entry["min"][0].get<double>(), 0.5, 1e-6);
  EXPECT_NEAR(entry["max"][1].get<double>(), 1.5, 1e-6);
  const float bed = parts::Terrain(world, kSeed).height(1.0F, 1.0F);
  EXPECT_LT(entry["min"][2].get<float>(), bed + 0.02F);
  EXPECT_GT(entry["max"][2].get<float>(), bed - 0.02F);
  EXPECT_LT(entry["max"][2].get<float>(), bed + 1.5F);
}

TEST(Recolored, MixesTheAlbedoInsideOnly) {
  const std::vector<Tint> tints = {
      {.x = 1.0F, .y = 2.0F, .radius = 0.5F, .r = 1.0F, .g = 0.0F, .b = 0.4F, .amount = 0.5F}};
  SurfaceBatch batch;
  for (Lanes* lanes : {&batch.r, &batch.g, &batch.b}) lanes->fill(0.2F);
  batch.p.y.fill(2.0F);
  batch.p.x.fill(1.6F);
  batch.p.x[0] = 1.0F;
  batch.p.x[1] = 1.45F;
  apply_tints(tints, batch);
  EXPECT_NEAR(batch.r[0], 0.6F, 1e-6F);
  EXPECT_NEAR(batch.g[0], 0.1F, 1e-6F);
  EXPECT_NEAR(batch.b[0], 0.3F, 1e-6F);
  EXPECT_NEAR(batch.r[1], 0.4F, 1e-5F) << "half of it in the middle of the fading edge";
  EXPECT_EQ(batch.r[2], 0.2F);
}

double coral_area(const TriangleMesh& mesh) {
  double area = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (mesh.materials[i] != Material::sponge) continue;
    const TriangleMesh::Triangle& t = mesh.triangles[i];
    const Eigen::Vector3f& a = mesh.vertices[t[0]];
    area += 0.5 * (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a).norm();
  }
  return area;
}

TEST(Growth, ScalesTheSameMarineLife) {
  WorldConfig world = small_world();
  const double before = coral_area(make_world(world, kSeed));
  world.growth = 1.5;
  EXPECT_GT(before, 0.1);
  EXPECT_NEAR(coral_area(make_world(world, kSeed)) / before, 1.5 * 1.5, 0.01);
}

TEST(Objects, ErrorsNameTheKey) {
  WorldConfig world;
  try {
    config::read(config::parse_yaml("objects: [{name: a, shape: ball}]", "w.yaml"), world);
    FAIL() << "an unknown shape is accepted";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("shape"));
    EXPECT_THAT(e.what(), HasSubstr("ball is none of: boulder"));
  }
}

TEST(Objects, NamesAreGivenAndDifferent) {
  WorldConfig world = with_object("tire", 0.4);
  EXPECT_EQ(error_of(world), "");
  world.recolored = {{.name = "tire"}};
  EXPECT_THAT(error_of(world), HasSubstr("world.recolored: two entries are named tire"));
  world.recolored.front().name = "";
  EXPECT_THAT(error_of(world), HasSubstr("world.recolored: an entry has no name"));
}

TEST(Objects, OutsideOfTheWorldAreRefused) {
  WorldConfig world = with_object("tire", 0.4);
  world.objects.front().x_m = 5.1;
  EXPECT_THAT(error_of(world), HasSubstr("world.objects: tire at x 5.1 m"));
}

}  // namespace
}  // namespace apvi::sim
