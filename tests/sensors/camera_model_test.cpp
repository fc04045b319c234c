// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/camera_model.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/numeric_jacobian.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using test::MatrixNear;

CameraModel::Parameters base(Distortion distortion, std::array<double, 4> coefficients) {
  return {.fx = 458.654,
          .fy = 457.296,
          .cx = 367.215,
          .cy = 248.375,
          .distortion = distortion,
          .coefficients = coefficients,
          .width = 752,
          .height = 480};
}

CameraModel plain() {
  return CameraModel(base(Distortion::none, {}));
}
CameraModel radtan() {  // left camera of EuRoC
  return CameraModel(
      base(Distortion::radtan, {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05}));
}
CameraModel folding() {  // barrel distortion that folds at tan(angle) = 0.91
  return CameraModel(base(Distortion::radtan, {-0.4, 0.0, 0.001, -0.002}));
}
CameraModel fisheye() {
  return CameraModel(base(Distortion::equidistant, {-0.013, 0.02, -0.012, 0.003}));
}

// Points in front of the camera, within `spread` of the axis (tangent).
std::vector<Vector3d> points_in_front(double spread) {
  Random random(5);
  std::vector<Vector3d> points = {Vector3d(0, 0, 1), Vector3d(1e-12, 0, 2), Vector3d(0, 1e-7, 0.5)};
  for (int i = 0; i < 200; ++i) {
    const double z = random.uniform(0.2, 20.0);
    points.emplace_back(z * random.uniform(-spread, spread), z * random.uniform(-spread, spread),
                        z);
  }
  return points;
}

cv::Matx33d intrinsics(const CameraModel& camera) {
  const auto& p = camera.parameters();
  return {p.fx, 0, p.cx, 0, p.fy, p.cy, 0, 0, 1};
}

cv::Vec4d coefficients(const CameraModel& camera) {
  const auto& k = camera.parameters().coefficients;
  return {k[0], k[1], k[2], k[3]};
}

Vector2d opencv_projection(const CameraModel& camera, const Vector3d& p) {
  const std::vector<cv::Point3d> points = {{p.x(), p.y(), p.z()}};
  std::vector<cv::Point2d> pixels;
  const cv::Vec3d zero(0, 0, 0);
  if (camera.parameters().distortion == Distortion::equidistant) {
    cv::fisheye::projectPoints(points, pixels, zero, zero, intrinsics(camera),
                               coefficients(camera));
  } else {
    cv::projectPoints(points, zero, zero, intrinsics(camera), coefficients(camera), pixels);
  }
  return {pixels[0].x, pixels[0].y};
}

TEST(CameraModel, ProjectionMatchesOpenCv) {
  for (const CameraModel& camera : {plain(), radtan(), fisheye()}) {
    for (const Vector3d& p : points_in_front(0.9)) {
      const auto pixel = camera.project(p);
      ASSERT_TRUE(pixel.has_value()) << p.transpose();
      EXPECT_THAT(*pixel, MatrixNear(opencv_projection(camera, p), 1e-9)) << p.transpose();
    }
  }
}

TEST(CameraModel, JacobianIsDerivativeOfProjection) {
  for (const CameraModel& camera : {plain(), radtan(), folding(), fisheye()}) {
    for (const Vector3d& p : points_in_front(0.5)) {
      CameraModel::Jacobian23 jacobian;
      ASSERT_TRUE(camera.project(p, &jacobian));
      const double step = 1e-6 * p.z();
      const auto numeric = test::numeric_jacobian(
          [&](const Vector3d& d) { return *camera.project(p + d); }, 3, step);
      EXPECT_THAT(jacobian, MatrixNear(numeric, 1e-6 * (1.0 + numeric.norm()))) << p.transpose();
    }
  }
}

TEST(CameraModel, UnprojectInvertsProject) {
  for (const CameraModel& camera : {plain(), radtan(), folding(), fisheye()}) {
    for (const Vector3d& p : points_in_front(0.55)) {
      const auto ray = camera.unproject(*camera.project(p));
      ASSERT_TRUE(ray.has_value()) << p.transpose();
      EXPECT_THAT(*ray, MatrixNear(p.normalized(), 1e-9)) << p.transpose();
    }
  }
}

TEST(CameraModel, ProjectInvertsUnprojectOverImage) {
  for (const CameraModel& camera : {plain(), radtan(), fisheye()}) {
    for (double u = 0.0; u < 752.0; u += 37.55) {
      for (double v = 0.0; v < 480.0; v += 23.95) {
        const auto ray = camera.unproject({u, v});
        ASSERT_TRUE(ray.has_value()) << u << " " << v;
        EXPECT_NEAR(ray->norm(), 1.0, 1e-14);
        EXPECT_THAT(*camera.project(*ray), MatrixNear(Vector2d(u, v), 1e-8));
      }
    }
  }
}

TEST(CameraModel, DoesNotProjectPointsBehindCamera) {
  for (const CameraModel& camera : {plain(), radtan()}) {
    EXPECT_FALSE(camera.project({0, 0, -1}));
    EXPECT_FALSE(camera.project({0.3, 0.2, 0}));
    EXPECT_FALSE(camera.project({0, 0, 0}));
  }
  EXPECT_FALSE(fisheye().project({0, 0, -1}));
  EXPECT_FALSE(fisheye().project({0, 0, 0}));
}

TEST(CameraModel, FisheyeProjectsBeyondNinetyDegrees) {
  const auto pixel = fisheye().project(Vector3d(1.0, 0.0, -0.1));
  ASSERT_TRUE(pixel.has_value());
  EXPECT_GT(pixel->x(), 367.0 + 458.0 * std::numbers::pi / 2.0);
}

TEST(CameraModel, RejectsRaysBeyondRadtanFold) {
  const double fold = std::sqrt(1.0 / (3.0 * 0.4));
  const CameraModel camera = folding();
  EXPECT_TRUE(camera.project({0.98 * fold, 0, 1}));
  EXPECT_FALSE(camera.project({1.02 * fold, 0, 1}));
  const Vector3d far(1.5, 0.0, 1.0);
  EXPECT_TRUE(camera.in_image(opencv_projection(camera, far)));  // without the check
  EXPECT_FALSE(camera.project(far));
}

TEST(CameraModel, RejectsRaysBeyondFisheyeFold) {
  const CameraModel camera(base(Distortion::equidistant, {-0.2, 0.0, 0.0, 0.0}));
  const double fold = std::sqrt(1.0 / 0.6);  // of the angle
  EXPECT_TRUE(camera.project({std::sin(0.98 * fold), 0, std::cos(0.98 * fold)}));
  EXPECT_FALSE(camera.project({std::sin(1.02 * fold), 0, std::cos(1.02 * fold)}));
}

TEST(CameraModel, UnprojectRejectsUnreachablePixels) {
  EXPECT_FALSE(folding().unproject({367.0 + 458.0, 248.0}));
  const CameraModel fish(base(Distortion::equidistant, {-0.2, 0.0, 0.0, 0.0}));
  EXPECT_FALSE(fish.unproject({367.0 + 458.0 * 1.2, 248.0}));
  EXPECT_FALSE(radtan().unproject({std::nan(""), 0.0}));
}

TEST(CameraModel, ImageBoundsAreOuterPixelCenters) {
  const CameraModel camera = plain();
  EXPECT_TRUE(camera.in_image({0, 0}));
  EXPECT_TRUE(camera.in_image({751, 479}));
  EXPECT_FALSE(camera.in_image({751.01, 100}));
  EXPECT_FALSE(camera.in_image({-0.01, 100}));
  EXPECT_FALSE(camera.in_image({5, 100}, 6.0));
  EXPECT_FALSE(camera.in_image({std::nan(""), 100}));
}

TEST(CameraModel, RequiresFocalLength) {
  EXPECT_THROW(CameraModel(CameraModel::Parameters{}), std::logic_error);
}

}  // namespace
}  // namespace apvi
