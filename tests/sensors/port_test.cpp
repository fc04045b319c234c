// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/port.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "apvi/core/error.hpp"
#include "core/random.hpp"
#include "port_cameras.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using test::dome_port;
using test::flat_port;
using test::lens_in_air;
using test::MatrixNear;

std::vector<Port> ports() {
  return {flat_port(),
          flat_port(0.002),
          flat_port(0.05, 0.1),
          dome_port(Vector3d::Zero()),
          dome_port({0.004, -0.003, 0.01}),
          dome_port({0.0, 0.0, -0.02})};
}

std::vector<Vector3d> points_in_water(double nearest = 0.3) {
  Random random(3);
  std::vector<Vector3d> points = {Vector3d(0, 0, 1), Vector3d(1e-9, 0, 2)};
  for (int i = 0; i < 60; ++i) {
    const double z = random.uniform(nearest, 8.0);
    points.emplace_back(z * random.uniform(-0.6, 0.6), z * random.uniform(-0.5, 0.5), z);
  }
  return points;
}

// Optical path from the lens center to a point that crosses the two surfaces of the port at points
// given by their position across the straight line [m].
class OpticalPath {
 public:
  OpticalPath(const Port& port, const Vector3d& point) : port_(port), point_(point) {
    line_ = point.normalized();
    u_ = line_.unitOrthogonal();
    v_ = line_.cross(u_);
  }
  double length(const Eigen::Vector4d& x) const {
    const Vector3d inner = on_surface(x.head<2>(), 0.0);
    const Vector3d outer = on_surface(x.tail<2>(), port_.glass_thickness_m);
    return port_.air_index * inner.norm() + port_.glass_index * (outer - inner).norm() +
           port_.water_index * (point_ - outer).norm();
  }
  Vector3d on_surface(const Vector2d& across, double depth) const {
    const Vector3d start = across.x() * u_ + across.y() * v_;
    if (port_.kind == PortKind::flat) {
      const double along =
          (port_.distance_m + depth - port_.normal.dot(start)) / port_.normal.dot(line_);
      return start + along * line_;
    }
    const Vector3d from = start - port_.center;
    const double b = from.dot(line_);
    const double radius = port_.radius_m + depth;
    return start + (std::sqrt(b * b - from.squaredNorm() + radius * radius) - b) * line_;
  }
  // Pattern search: knows nothing of Snell's law.
  Eigen::Vector4d shortest() const {
    Eigen::Vector4d x = Eigen::Vector4d::Zero();
    double best = length(x);
    for (double step = 5e-3; step > 1e-10;) {
      bool improved = false;
      for (int i = 0; i < 4; ++i) {
        for (const double sign : {-1.0, 1.0}) {
          Eigen::Vector4d next = x;
          next(i) += sign * step;
          const double value = length(next);
          if (!(value < best)) continue;
          best = value;
          x = next;
          improved = true;
        }
      }
      if (!improved) step *= 0.5;
    }
    return x;
  }

 private:
  Port port_;
  Vector3d point_;
  Vector3d line_, u_, v_;
};

TEST(PortCamera, ProjectsAlongThePathOfLeastTime) {
  for (const Port& port : ports()) {
    const PortCamera camera(lens_in_air(), port);
    for (const Vector3d& point : points_in_water()) {
      const OpticalPath path(port, point);
      const Vector3d in_air = path.on_surface(path.shortest().head<2>(), 0.0);
      const auto expected = lens_in_air().project(in_air);
      const auto pixel = camera.project(point);
      ASSERT_EQ(pixel.has_value(), expected.has_value());
      // The search resolves some 1e-8 m on the port: rounding hides smaller changes of the length.
      if (!pixel) continue;
      EXPECT_THAT(*pixel, MatrixNear(*expected, 5e-3)) << point.transpose();
    }
  }
}

TEST(PortCamera, RaysObeySnellsLaw) {
  for (const Port& port : ports()) {
    const PortCamera camera(lens_in_air(), port);
    for (const Vector2d& pixel : {Vector2d(0, 0), Vector2d(639, 100), Vector2d(320, 479)}) {
      const auto ray = camera.ray(pixel);
      ASSERT_TRUE(ray);
      if (port.kind != PortKind::flat) continue;
      const Vector3d in_air = *lens_in_air().unproject(pixel);
      EXPECT_NEAR(port.air_index * in_air.cross(port.normal).norm(),
                  port.water_index * ray->direction.cross(port.normal).norm(), 1e-12);
      EXPECT_NEAR(ray->origin.dot(port.normal), port.distance_m + port.glass_thickness_m, 1e-12);
      EXPECT_NEAR(in_air.cross(port.normal).dot(ray->direction), 0.0, 1e-12);
    }
  }
}

TEST(PortCamera, ProjectionInvertsRaysOverTheImage) {
  for (const Port& port : ports()) {
    const PortCamera camera(lens_in_air(), port);
    for (double u = 0.0; u < 640.0; u += 31.95) {
      for (double v = 0.0; v < 480.0; v += 47.9) {
        const auto ray = camera.ray({u, v});
        ASSERT_TRUE(ray) << u << " " << v;
        for (const double range : {0.05, 0.3, 2.0, 50.0}) {
          const auto pixel = camera.project(ray->origin + range * ray->direction);
          ASSERT_TRUE(pixel) << u << " " << v << " " << range;
          EXPECT_THAT(*pixel, MatrixNear(Vector2d(u, v), 1e-7));
        }
      }
    }
  }
}

TEST(PortCamera, WithoutRefractionIsTheLens) {
  for (Port port : ports()) {
    port.glass_index = port.water_index = 1.0;
    const PortCamera camera(lens_in_air(), port);
    for (const Vector3d& point : points_in_water()) {
      const auto pixel = camera.project(point);
      const auto expected = lens_in_air().project(point);
      ASSERT_EQ(pixel.has_value(), expected.has_value());
      if (!pixel) continue;
      EXPECT_THAT(*pixel, MatrixNear(*expected, 1e-8));
    }
  }
}

TEST(PortCamera, ACenteredDomeIsTheLens) {
  const PortCamera camera(lens_in_air(), dome_port(Vector3d::Zero()));
  for (const Vector3d& point : points_in_water()) {
    EXPECT_THAT(*camera.project(point), MatrixNear(*lens_in_air().project(point), 1e-9));
  }
}

TEST(PortCamera, DoesNotSeePointsBehindThePort) {
  const PortCamera flat(lens_in_air(), flat_port());
  EXPECT_FALSE(flat.project({0, 0, 0.057}));
  EXPECT_TRUE(flat.project({0, 0, 0.059}));
  EXPECT_FALSE(flat.project({0, 0, -1}));
  const PortCamera dome(lens_in_air(), dome_port({0, 0, 0.01}));
  EXPECT_FALSE(dome.project({0, 0, 0.07}));
  EXPECT_FALSE(dome.project({0, 0, -1}));
}

TEST(PortCamera, RefusesALensOutsideOfItsAir) {
  EXPECT_THROW(PortCamera(lens_in_air(), flat_port(0.0)), InputError);
  EXPECT_THROW(PortCamera(lens_in_air(), dome_port({0, 0, 0.07})), InputError);
  Port reversed = flat_port();
  reversed.air_index = 1.4;
  EXPECT_THROW(PortCamera(lens_in_air(), reversed), InputError);
}

TEST(WaterRay, FindsThePointAtADistanceFromACenter) {
  const WaterRay ray{Vector3d(0.01, 0.0, 0.05), Vector3d(0.6, 0.0, 0.8)};
  const Vector3d center(0.0, 0.002, -0.01);
  const Vector3d point = ray.at(2.0, center);
  EXPECT_NEAR((point - center).norm(), 2.0, 1e-12);
  EXPECT_NEAR((point - ray.origin).cross(ray.direction).norm(), 0.0, 1e-12);
  EXPECT_GT((point - ray.origin).dot(ray.direction), 0.0);
}

}  // namespace
}  // namespace apvi
