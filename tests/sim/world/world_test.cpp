// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::sim {
namespace {

WorldConfig small_world(WorldKind kind) {
  return {.kind = kind, .depth_m = 9.0, .size_m = 12.0, .resolution_m = 0.15};
}

class EveryWorld : public testing::TestWithParam<WorldKind> {};

TEST_P(EveryWorld, MeshIsConsistent) {
  const TriangleMesh mesh = make_world(small_world(GetParam()), 5);
  ASSERT_EQ(mesh.detail.size(), mesh.vertices.size());
  ASSERT_EQ(mesh.materials.size(), mesh.triangles.size());
  ASSERT_EQ(mesh.objects.size(), mesh.triangles.size());
  ASSERT_GT(mesh.triangles.size(), 10000U);
  EXPECT_TRUE(std::all_of(mesh.vertices.begin(), mesh.vertices.end(),
                          [](const auto& v) { return v.allFinite(); }));
  EXPECT_TRUE(std::all_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const auto& t) {
    return std::max({t[0], t[1], t[2]}) < mesh.vertices.size();
  }));
  EXPECT_LT(mesh.bounds().max().z(), 1.0F);
  EXPECT_LT(mesh.bounds().min().z(), -8.0F);
}

TEST_P(EveryWorld, IsDeterminedByTheSeed) {
  const TriangleMesh a = make_world(small_world(GetParam()), 5);
  const TriangleMesh b = make_world(small_world(GetParam()), 5);
  const TriangleMesh c = make_world(small_world(GetParam()), 6);
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.objects, b.objects);
  EXPECT_NE(a.vertices, c.vertices);
}

INSTANTIATE_TEST_SUITE_P(Worlds, EveryWorld,
                         testing::Values(WorldKind::seabed, WorldKind::ship, WorldKind::dam));

// Standard deviation of the vertex heights in a disc.
double roughness(const TriangleMesh& mesh, double x, double y, double radius) {
  std::vector<double> heights;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    if (std::hypot(v.x() - x, v.y() - y) < radius) heights.push_back(v.z());
  }
  double mean = 0.0;
  for (const double h : heights) mean += h / static_cast<double>(heights.size());
  double square = 0.0;
  for (const double h : heights) square += (h - mean) * (h - mean);
  return std::sqrt(square / static_cast<double>(heights.size()));
}

TEST(Seabed, BarePatchIsSmooth) {
  WorldConfig config = small_world(WorldKind::seabed);
  config.relief_m = 0.0;
  const double usual = roughness(make_world(config, 5), 0.0, 0.0, 2.5);
  config.bare_patches = {{.x_m = 0.0, .y_m = 0.0, .radius_m = 3.0}};
  EXPECT_LT(roughness(make_world(config, 5), 0.0, 0.0, 2.5), 1e-3);
  EXPECT_GT(usual, 0.03);
}

TEST(Dam, HasWallWithRecessedGate) {
  const TriangleMesh mesh = make_world(small_world(WorldKind::dam), 5);
  const auto near_wall = [&](double x, double z) {
    return std::any_of(mesh.vertices.begin(), mesh.vertices.end(), [&](const auto& v) {
      return std::abs(v.x() - x) < 0.2 && std::abs(v.z() - z) < 0.2 && std::abs(v.y()) < 0.11;
    });
  };
  EXPECT_TRUE(near_wall(-2.0, -5.0));
  EXPECT_FALSE(near_wall(-7.0, -6.0)) << "the gate is recessed";
}

TEST(Ply, ContainsAllVerticesAndTriangles) {
  TriangleMesh mesh;
  for (int i = 0; i < 4; ++i) mesh.add_vertex({static_cast<float>(i), 1.0F, -2.0F});
  mesh.add_quad(0, 1, 2, 3, Material::rock);
  const test::TmpDir folder;
  write_ply(mesh, folder.path() / "mesh.ply");
  std::ifstream file(folder.path() / "mesh.ply", std::ios::binary);
  std::stringstream content;
  content << file.rdbuf();
  const std::string bytes = content.str();
  const std::size_t body = bytes.find("end_header\n") + 11;
  EXPECT_NE(bytes.find("element vertex 4\n"), std::string::npos);
  EXPECT_NE(bytes.find("element face 2\n"), std::string::npos);
  EXPECT_EQ(bytes.size() - body, 4U * 12U + 2U * 14U);
}

TEST(Ply, ThrowsWhenFolderDoesNotExist) {
  EXPECT_THROW(write_ply({}, "/nowhere/at/all/mesh.ply"), RunError);
}

TEST(WorldConfig, RejectsUnknownKindAndInvalidSize) {
  WorldConfig config;
  EXPECT_THROW(config::read(config::parse_yaml("kind: moon", "w.yaml"), config), InputError);
  EXPECT_THROW(config::read(config::parse_yaml("size_m: 1e6", "w.yaml"), config), InputError);
}

}  // namespace
}  // namespace apvi::sim
