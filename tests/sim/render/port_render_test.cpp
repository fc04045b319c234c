// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <string>

#include "apvi/config/node.hpp"
#include "apvi/sensors/rig.hpp"
#include "sim/render/renderer.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

// A plane at `distance` in front of the origin along y, that leans back.
constexpr float kSlope = 0.6F;
TriangleMesh leaning_wall(float distance) {
  TriangleMesh mesh;
  const auto add = [&](float x, float z) {
    mesh.add_vertex(Vector3f(x, distance + kSlope * z, z));
  };
  add(-30.0F, -30.0F);
  add(30.0F, -30.0F);
  add(30.0F, 30.0F);
  add(-30.0F, 30.0F);
  mesh.add_quad(0, 1, 2, 3, Material::plain);
  return mesh;
}

// Looks along y of the world.
CameraCalibration camera_behind(const std::string& port) {
  const Rig rig = make_rig(
      config::parse_yaml("cam0:\n  intrinsics: [100, 101, 79.5, 59.5]\n  resolution: [160, 120]\n"
                         "  T_body_sensor: [1,0,0,0, 0,0,1,0, 0,-1,0,0, 0,0,0,1]\n  port: " +
                             port,
                         "rig.yaml"));
  return rig.cameras.at(0);
}

RendererConfig bare_config() {
  RendererConfig config;
  config.water.snow.density_per_m3 = 0.0;
  config.camera.exposure_s = 0.0;
  return config;
}

double interpolated(const cv::Mat& image, const Vector2d& pixel) {
  const int x = static_cast<int>(pixel.x());
  const int y = static_cast<int>(pixel.y());
  const double u = pixel.x() - x;
  const double v = pixel.y() - y;
  const auto at = [&](int dx, int dy) -> double { return image.at<float>(y + dy, x + dx); };
  return (1 - v) * ((1 - u) * at(0, 0) + u * at(1, 0)) + v * ((1 - u) * at(0, 1) + u * at(1, 1));
}

// The wall leans, so depth says where on the wall a pixel looks.
TEST(RendererBehindAPort, PointsOfTheMeshAreWhereThePortShowsThem) {
  for (const char* port : {"{distance_m: 0.05}", "{distance_m: 0.03, tilt_deg: [4, -3]}",
                           "{kind: dome, radius_m: 0.05, center_m: [0, 0, 0.01]}"}) {
    const CameraCalibration camera = camera_behind(port);
    const TriangleMesh mesh = leaning_wall(1.0F);
    const RayCaster caster(mesh);
    const Renderer renderer(mesh, caster, camera.model, bare_config(), 7, 1, camera.port);
    ImageRequest request;
    request.T_world_camera = [&](Stamp) { return camera.T_body_camera; };
    const cv::Mat depth = renderer.render(request).depth;
    int seen = 0;
    for (double x = -0.9; x < 1.0; x += 0.07) {
      for (double z = -0.5; z < 0.6; z += 0.05) {
        const Vector3d point(x, 1.0 + static_cast<double>(kSlope) * z, z);
        const auto pixel = camera.port->camera.project(camera.T_body_lens().inverse() * point);
        if (!pixel || !camera.lens().in_image(*pixel, 2.0)) continue;
        ++seen;
        const double expected = (camera.T_body_camera.inverse() * point).z();
        const double per_pixel = 0.5 * std::abs(interpolated(depth, *pixel + Vector2d::UnitY()) -
                                                interpolated(depth, *pixel - Vector2d::UnitY()));
        ASSERT_GT(per_pixel, 1e-3);
        EXPECT_LT(std::abs(interpolated(depth, *pixel) - expected) / per_pixel, 0.02)
            << port << " " << point.transpose();
      }
    }
    EXPECT_GT(seen, 100);
  }
}

}  // namespace
}  // namespace apvi::sim
