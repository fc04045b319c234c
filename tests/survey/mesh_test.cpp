// SPDX-License-Identifier: BSD-3-Clause
#include "survey/mesh.hpp"

#include <gtest/gtest.h>
#include <open3d/geometry/TriangleMesh.h>
#include <open3d/io/TriangleMeshIO.h>
#include <torch/torch.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"
#include "survey/flat_ground.hpp"
#include "survey/mesh_views.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr double kVoxel_m = 0.02;

/// A camera at `from` that looks at the origin.
SurveyView looking_at_origin(const Eigen::Vector3d& from) {
  const Eigen::Vector3d z = -from.normalized();
  const Eigen::Vector3d x = z.unitOrthogonal();
  Eigen::Matrix3d R;
  R << x.transpose(), z.cross(x).transpose(), z.transpose();
  const Eigen::Vector3d t = -(R * from);
  gaussians::View view;
  view.intrinsics = {.fx = 120.0, .fy = 120.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
  view.T_camera_world = torch::eye(4, torch::kFloat64);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) view.T_camera_world[i][j] = R(i, j);
    view.T_camera_world[i][3] = t[i];
  }
  return {view};
}

/// Flat Gaussians on a sphere around the origin, by a Fibonacci lattice.
mapping::Map sphere_map(double radius_m, std::int64_t count) {
  const Tensor i = torch::arange(count, torch::kFloat64) + 0.5;
  const Tensor height = 1.0 - 2.0 * i / static_cast<double>(count);
  const Tensor azimuth = i * std::numbers::pi * (1.0 + std::sqrt(5.0));
  const Tensor ring = (1.0 - height.square()).sqrt();
  const Tensor normals = torch::stack({ring * azimuth.cos(), ring * azimuth.sin(), height}, 1);
  // The rotation from z to the normal: w = 1 + n_z, (x, y) = (-n_y, n_x).
  const auto n = normals.unbind(1);
  const Tensor quaternions = torch::stack({1.0 + n[2], -n[1], n[0], torch::zeros({count})}, 1);
  const double sigma = radius_m * std::sqrt(4.0 * std::numbers::pi / static_cast<double>(count));
  mapping::Map map;
  map.gaussians = {
      .means = (radius_m * normals).to(torch::kFloat32),
      .log_scales = torch::tensor({sigma, sigma, 1e-4}, torch::kFloat32).log().repeat({count, 1}),
      .quaternions = quaternions.to(torch::kFloat32),
      .logit_opacities = torch::full({count}, 3.0F),
      .sh_dc = gaussians::color_to_sh_dc(torch::tensor({0.6F, 0.3F, 0.1F}).repeat({count, 1})),
      .sh_rest = torch::zeros({count, 0, 3})};
  return map;
}

Tensor corner(const Mesh& mesh, std::int64_t which) {
  return mesh.vertices.index_select(0, mesh.triangles.select(1, which).to(torch::kInt64));
}

TEST(Fuse, AHemisphereHasItsRadiusColorAndOutside) {
  std::vector<SurveyView> views;
  for (int k = 0; k < 8; ++k) {
    const double azimuth = k * std::numbers::pi / 4.0;
    views.push_back(looking_at_origin({std::cos(azimuth), std::sin(azimuth), 1.0}));
  }
  views.push_back(looking_at_origin({0.0, 0.0, 1.5}));
  const Mesh mesh = fuse(sphere_map(0.5, 8000), views, {}, kVoxel_m, [](double) {});
  const Tensor upper = mesh.vertices.select(1, 2) > 0.1;
  const Tensor radius = mesh.vertices.norm(2, 1).index({upper});
  EXPECT_GT(radius.size(0), 1000);
  EXPECT_LT((radius - 0.5).abs().mean().item<double>(), 0.003);
  const Tensor color = mesh.colors.index({upper}).mean(0);
  EXPECT_NEAR(color[0].item<double>(), 0.6, 0.02);
  EXPECT_NEAR(color[2].item<double>(), 0.1, 0.02);
  const Tensor normal =
      torch::cross(corner(mesh, 1) - corner(mesh, 0), corner(mesh, 2) - corner(mesh, 0), 1);
  const Tensor outward = (normal * corner(mesh, 0)).sum(1) >= 0.0;
  EXPECT_GT(outward.to(torch::kFloat64).mean().item<double>(), 0.99);
  EXPECT_GT(mesh.vertices.select(1, 2).min().item<double>(), -0.4);  // nothing was seen there
}

TEST(Fuse, AHoleInThePlaneStaysAHole) {
  SurveyMap plane = test::plane_map({.side_m = 1.2, .height_m = 0.0});
  const Tensor radius = plane.map.gaussians.means.slice(1, 0, 2).norm(2, 1);
  plane.map.gaussians.logit_opacities.masked_fill_(radius < 0.2, -9.0);
  const Mesh mesh =
      fuse(plane.map, {looking_at_origin({0.0, 0.0, 1.0})}, {}, kVoxel_m, [](double) {});
  const Tensor at = mesh.vertices.slice(1, 0, 2).norm(2, 1);
  EXPECT_GT(at.min().item<double>(), 0.1);
  EXPECT_LT(at.min().item<double>(), 0.25);
  EXPECT_LT(mesh.vertices.select(1, 2).abs().mean().item<double>(), 0.001);
}

TEST(Fuse, TheSurfaceIsWhereTheViewsSayAndAHoleWhereTheyConfirmNone) {
  const SurveyMap plane = test::plane_map({.side_m = 1.2, .height_m = 0.0});
  SurveyView view = looking_at_origin({0.0, 0.0, 1.0});
  view.depth_change = torch::full({60, 80}, 0.05F);
  view.depth_change.slice(1, 0, 40) = std::numeric_limits<float>::quiet_NaN();
  view.depth_change = view.depth_change.to(torch::kHalf);
  const Mesh mesh = fuse(plane.map, {view}, {}, kVoxel_m, [](double) {});
  EXPECT_NEAR(mesh.vertices.select(1, 2).median().item<double>(), -0.05, 0.002);
  const Tensor right = mesh.vertices.to(torch::kFloat64)
                           .mm(view.camera.T_camera_world.slice(0, 0, 1).slice(1, 0, 3).t());
  EXPECT_GT(right.min().item<double>(), -2.0 * kVoxel_m);
}

/// Depth [H,W] of the plane z = 0.
Tensor ground_depth(const gaussians::View& view) {
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor R = view.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  const Tensor up = R.select(1, 2);
  const double height = -up.dot(view.T_camera_world.slice(0, 0, 3).select(1, 3)).item<double>();
  const Tensor x = (torch::arange(k.width, torch::kFloat64) + 0.5 - k.cx) / k.fx;
  const Tensor y = (torch::arange(k.height, torch::kFloat64) + 0.5 - k.cy) / k.fy;
  return -height / (up[0] * x + up[1] * y.unsqueeze(1) + up[2]);
}

TEST(ReliableDepth, ASlantedPlaneIsExactBetweenThePixelsOfACoarserImage) {
  const SurveyMap plane = test::plane_map({.side_m = 2.0, .height_m = 0.0});
  SurveyView view = looking_at_origin({0.8, 0.0, 1.0});
  const gaussians::Intrinsics& k = view.camera.intrinsics;
  view.depth_change = torch::zeros({k.height / 4, k.width / 4}, torch::kHalf);
  const Tensor depth = reliable_depth(plane.map, view);
  ASSERT_EQ(depth.size(1), k.width);
  // The coarser image draws the border of the map wider than it is.
  const auto middle = [&](const Tensor& image) {
    return image.slice(0, k.height / 4, k.height / 2).slice(1, k.width / 4, 3 * k.width / 4);
  };
  const Tensor error = (middle(depth) - middle(ground_depth(view.camera))).abs();
  EXPECT_LT(error.max().item<double>(), 0.002);
}

TEST(Fuse, AMapWithNothingInItHasAnEmptyMesh) {
  mapping::Map map;
  map.gaussians = gaussians::Gaussians::empty(0, torch::kFloat32);
  const Mesh mesh = fuse(map, {looking_at_origin({0.0, 0.0, 1.0})}, {}, kVoxel_m, [](double) {});
  EXPECT_EQ(mesh.vertices.size(0), 0);
  EXPECT_EQ(mesh.triangles.size(0), 0);
}

TEST(WriteMesh, PlyIsReadBackWithColors) {
  const Mesh mesh{torch::tensor({{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}}),
                  torch::tensor({{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}),
                  torch::tensor({{0, 1, 2}}, torch::kInt32)};
  const Mesh exact{mesh.vertices.to(torch::kFloat64), mesh.colors.to(torch::kFloat64),
                   mesh.triangles};
  const test::TmpDir dir;
  write_mesh(dir.path() / "m.ply", exact, {Eigen::Quaterniond::Identity(), {10.0, 20.0, 30.0}});
  open3d::geometry::TriangleMesh read;
  ASSERT_TRUE(open3d::io::ReadTriangleMesh((dir.path() / "m.ply").string(), read));
  ASSERT_EQ(read.vertices_.size(), 3U);
  EXPECT_LT((read.vertices_[1] - Eigen::Vector3d(11.0, 20.0, 30.0)).norm(), 1e-6);
  EXPECT_LT((read.vertex_colors_[1] - Eigen::Vector3d(0.0, 1.0, 0.0)).norm(), 1e-2);
  EXPECT_TRUE(read.HasVertexNormals());
}

TEST(WriteMesh, AFolderThatDoesNotExistIsNamed) {
  const Mesh mesh{torch::zeros({3, 3}, torch::kFloat64), torch::zeros({3, 3}, torch::kFloat64),
                  torch::tensor({{0, 1, 2}}, torch::kInt32)};
  EXPECT_THROW(write_mesh("/does/not/exist/m.ply", mesh, {}), RunError);
}

}  // namespace
}  // namespace apvi::survey
