// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/camera_model.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <utility>
#include <vector>

#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/numeric_jacobian.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using test::MatrixNear;

CameraModel::Parameters base(Distortion distortion, const CameraModel::Coefficients& coefficients) {
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
CameraModel radtan5() {
  return CameraModel(base(Distortion::radtan, {-0.29, 0.11, 0.0004, -0.0003, -0.02}));
}
CameraModel rational() {  // a wide lens of a depth camera
  return CameraModel(base(Distortion::radtan, {0.61, 0.02, 4e-5, -3e-5, 1e-3, 0.95, 0.11, 5e-3}));
}
CameraModel strong_rational() {  // Newton's method from the distorted point leaves the lens
  return CameraModel(base(Distortion::radtan, {0.2, 0.0, 0.0, 0.0, 0.0, 1.1, 0.0, 0.0}));
}
CameraModel double_sphere() {  // as of a lens of 195 degrees in Usenko 2018
  return CameraModel({.fx = 190.2,
                      .fy = 190.1,
                      .cx = 375.5,
                      .cy = 239.5,
                      .distortion = Distortion::double_sphere,
                      .coefficients = {-0.237, 0.578},
                      .width = 752,
                      .height = 480});
}
CameraModel eucm() {
  return CameraModel({.fx = 250.0,
                      .fy = 251.0,
                      .cx = 375.5,
                      .cy = 239.5,
                      .distortion = Distortion::eucm,
                      .coefficients = {0.63, 1.04},
                      .width = 752,
                      .height = 480});
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

std::vector<double> coefficients(const CameraModel& camera) {
  const auto& k = camera.parameters().coefficients;
  return {k.begin(), k.end()};
}

Vector2d opencv_projection(const CameraModel& camera, const Vector3d& p) {
  const std::vector<cv::Point3d> points = {{p.x(), p.y(), p.z()}};
  std::vector<cv::Point2d> pixels;
  const cv::Vec3d zero(0, 0, 0);
  if (camera.parameters().distortion == Distortion::equidistant) {
    const auto k = coefficients(camera);
    cv::fisheye::projectPoints(points, pixels, zero, zero, intrinsics(camera),
                               cv::Vec4d(k[0], k[1], k[2], k[3]));
  } else {
    cv::projectPoints(points, zero, zero, intrinsics(camera), coefficients(camera), pixels);
  }
  return {pixels[0].x, pixels[0].y};
}

TEST(CameraModel, ProjectionMatchesOpenCv) {
  for (const CameraModel& camera :
       {plain(), radtan(), radtan5(), rational(), strong_rational(), fisheye()}) {
    for (const Vector3d& p : points_in_front(0.9)) {
      const auto pixel = camera.project(p);
      ASSERT_TRUE(pixel.has_value()) << p.transpose();
      EXPECT_THAT(*pixel, MatrixNear(opencv_projection(camera, p), 1e-9)) << p.transpose();
    }
  }
}

TEST(CameraModel, JacobianIsDerivativeOfProjection) {
  for (const CameraModel& camera : {plain(), radtan(), radtan5(), rational(), strong_rational(),
                                    folding(), fisheye(), double_sphere(), eucm()}) {
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
  for (const CameraModel& camera : {plain(), radtan(), radtan5(), rational(), strong_rational(),
                                    folding(), fisheye(), double_sphere(), eucm()}) {
    for (const Vector3d& p : points_in_front(0.55)) {
      const auto ray = camera.unproject(*camera.project(p));
      ASSERT_TRUE(ray.has_value()) << p.transpose();
      EXPECT_THAT(*ray, MatrixNear(p.normalized(), 1e-9)) << p.transpose();
    }
  }
}

TEST(CameraModel, ProjectInvertsUnprojectOverImage) {
  for (const CameraModel& camera :
       {plain(), radtan(), radtan5(), rational(), fisheye(), double_sphere(), eucm()}) {
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

// The equations as Usenko 2018 writes them.
Vector2d published_double_sphere(const CameraModel::Parameters& c, const Vector3d& p) {
  const auto [xi, alpha] = std::pair(c.coefficients[0], c.coefficients[1]);
  const double d1 = std::sqrt(p.x() * p.x() + p.y() * p.y() + p.z() * p.z());
  const double d2 = std::sqrt(p.x() * p.x() + p.y() * p.y() + std::pow(xi * d1 + p.z(), 2));
  const double below = alpha * d2 + (1 - alpha) * (xi * d1 + p.z());
  return {c.fx * p.x() / below + c.cx, c.fy * p.y() / below + c.cy};
}

Vector2d published_eucm(const CameraModel::Parameters& c, const Vector3d& p) {
  const auto [alpha, beta] = std::pair(c.coefficients[0], c.coefficients[1]);
  const double d = std::sqrt(beta * (p.x() * p.x() + p.y() * p.y()) + p.z() * p.z());
  const double below = alpha * d + (1 - alpha) * p.z();
  return {c.fx * p.x() / below + c.cx, c.fy * p.y() / below + c.cy};
}

// Rays up to an angle from the axis.
std::vector<Vector3d> rays_within(double degrees) {
  std::vector<Vector3d> rays;
  for (double angle = 0.0; angle <= degrees; angle += 2.5) {
    for (double azimuth = 0.0; azimuth < 6.28; azimuth += 0.7) {
      const double a = angle * std::numbers::pi / 180.0;
      rays.emplace_back(std::sin(a) * std::cos(azimuth), std::sin(a) * std::sin(azimuth),
                        std::cos(a));
    }
  }
  return rays;
}

TEST(CameraModel, SphereModelsMatchTheirPapersBeyondNinetyDegrees) {
  for (const Vector3d& ray : rays_within(105.0)) {
    const auto ds = double_sphere();
    ASSERT_TRUE(ds.project(3.0 * ray)) << ray.transpose();
    EXPECT_THAT(*ds.project(3.0 * ray),
                MatrixNear(published_double_sphere(ds.parameters(), ray), 1e-9));
    EXPECT_THAT(*eucm().project(3.0 * ray),
                MatrixNear(published_eucm(eucm().parameters(), ray), 1e-9));
  }
}

TEST(CameraModel, SphereModelsInvertBeyondNinetyDegrees) {
  for (const CameraModel& camera : {double_sphere(), eucm()}) {
    for (const Vector3d& ray : rays_within(105.0)) {
      CameraModel::Jacobian23 jacobian;
      const auto pixel = camera.project(ray, &jacobian);
      ASSERT_TRUE(pixel) << ray.transpose();
      const auto back = camera.unproject(*pixel);
      ASSERT_TRUE(back) << ray.transpose();
      EXPECT_THAT(*back, MatrixNear(ray, 1e-10));
      const auto numeric = test::numeric_jacobian(
          [&](const Vector3d& d) { return *camera.project(ray + d); }, 3, 1e-6);
      EXPECT_THAT(jacobian, MatrixNear(numeric, 1e-6 * (1.0 + numeric.norm())));
    }
  }
}

TEST(CameraModel, SphereModelsEndWhereTheirImageFolds) {
  for (const CameraModel& camera : {double_sphere(), eucm()}) {
    double radius = 0.0;
    for (double angle = 0.0; angle < 3.1; angle += 0.01) {
      const auto pixel = camera.project({std::sin(angle), 0.0, std::cos(angle)});
      if (!pixel) break;
      EXPECT_GT(pixel->x() - 375.5, radius - 1e-9) << angle;
      radius = pixel->x() - 375.5;
    }
    EXPECT_FALSE(camera.project({0.0, 0.0, -1.0}));
    EXPECT_FALSE(camera.project({0.0, 0.0, 0.0}));
    EXPECT_FALSE(camera.unproject({375.5 + 1.5 * radius, 239.5}));
  }
}

TEST(CameraModel, RejectsCoefficientsOutsideTheModel) {
  EXPECT_THROW(CameraModel(base(Distortion::double_sphere, {1.2, 0.5})), std::logic_error);
  EXPECT_THROW(CameraModel(base(Distortion::eucm, {0.5, -1.0})), std::logic_error);
  EXPECT_THROW(CameraModel(base(Distortion::radtan, {std::nan("")})), std::logic_error);
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
