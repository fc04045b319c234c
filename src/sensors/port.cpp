// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/port.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "apvi/core/error.hpp"

namespace apvi {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Snell's law for a unit direction that crosses a surface with a unit normal of the same side.
std::optional<Vector3d> refract(const Vector3d& direction, const Vector3d& normal, double ratio) {
  const double c = direction.dot(normal);
  const double under_root = 1.0 - ratio * ratio * (1.0 - c * c);
  if (c <= 0.0 || under_root <= 0.0) return std::nullopt;
  return Vector3d(ratio * direction + (std::sqrt(under_root) - ratio * c) * normal).normalized();
}

std::optional<WaterRay> trace_flat(const Port& port, const Vector3d& in_air) {
  const double c = in_air.dot(port.normal);
  if (c <= 1e-6) return std::nullopt;
  const auto in_glass = refract(in_air, port.normal, port.air_index / port.glass_index);
  if (!in_glass) return std::nullopt;
  const auto in_water = refract(*in_glass, port.normal, port.glass_index / port.water_index);
  if (!in_water) return std::nullopt;
  return WaterRay{port.distance_m / c * in_air +
                      port.glass_thickness_m / in_glass->dot(port.normal) * *in_glass,
                  *in_water};
}

// Where a ray leaves the sphere around the dome's center.
Vector3d leave_sphere(const Vector3d& origin, const Vector3d& direction, const Vector3d& center,
                      double radius) {
  const Vector3d from_center = origin - center;
  const double b = from_center.dot(direction);
  return origin + (std::sqrt(b * b - from_center.squaredNorm() + radius * radius) - b) * direction;
}

std::optional<WaterRay> trace_dome(const Port& port, const Vector3d& in_air) {
  const Vector3d inner = leave_sphere(Vector3d::Zero(), in_air, port.center, port.radius_m);
  const auto in_glass =
      refract(in_air, (inner - port.center).normalized(), port.air_index / port.glass_index);
  if (!in_glass) return std::nullopt;
  const Vector3d outer =
      leave_sphere(inner, *in_glass, port.center, port.radius_m + port.glass_thickness_m);
  const auto in_water =
      refract(*in_glass, (outer - port.center).normalized(), port.glass_index / port.water_index);
  if (!in_water) return std::nullopt;
  return WaterRay{outer, *in_water};
}

std::optional<WaterRay> trace(const Port& port, const Vector3d& in_air) {
  return port.kind == PortKind::flat ? trace_flat(port, in_air) : trace_dome(port, in_air);
}

// Tangent of the angle after refraction of a ray whose tangent in air is `u`, and its derivative;
// `ratio` is the index of air over that of the layer.
double layer_tangent(double u, double ratio, double& slope) {
  const double root = std::sqrt(1.0 + (1.0 - ratio * ratio) * u * u);
  slope = ratio / (root * root * root);
  return ratio * u / root;
}

// Direction in air toward a point in the water. The distance from the axis at which a ray reaches
// the point's layer is concave in its tangent, so Newton's method from zero never overshoots.
std::optional<Vector3d> aim_flat(const Port& port, const Vector3d& point) {
  constexpr int kIterations = 60;
  const double height = port.normal.dot(point);
  const double in_water = height - port.distance_m - port.glass_thickness_m;
  if (!(in_water > 0.0)) return std::nullopt;
  const Vector3d across = point - height * port.normal;
  const double wanted = across.norm();
  if (wanted < 1e-12) return port.normal;
  double u = 0.0;
  for (int i = 0; i < kIterations; ++i) {
    double glass_slope = 0.0;
    double water_slope = 0.0;
    const double reached =
        port.distance_m * u +
        port.glass_thickness_m * layer_tangent(u, port.air_index / port.glass_index, glass_slope) +
        in_water * layer_tangent(u, port.air_index / port.water_index, water_slope);
    const double step =
        (wanted - reached) /
        (port.distance_m + port.glass_thickness_m * glass_slope + in_water * water_slope);
    u += step;
    if (std::abs(step) < 1e-14 * (1.0 + u)) break;
  }
  return Vector3d(port.normal + u / wanted * across);
}

// As above: the angle from the straight line, in the plane of lens, dome center and point, by the
// secant method on the distance between point and ray.
std::optional<Vector3d> aim_dome(const Port& port, const Vector3d& point) {
  constexpr int kIterations = 40;
  constexpr double kFirstStep = 1e-4;  // [rad]
  const double outer = port.radius_m + port.glass_thickness_m;
  if (!((point - port.center).norm() > outer)) return std::nullopt;
  const Vector3d along = point.normalized();
  const Vector3d off_axis = port.center - port.center.dot(along) * along;
  if (off_axis.norm() < 1e-12) return along;
  const Vector3d across = off_axis.normalized();
  const auto direction = [&](double angle) -> Vector3d {
    return std::cos(angle) * along + std::sin(angle) * across;
  };
  const auto miss = [&](double angle) -> std::optional<double> {
    const auto ray = trace_dome(port, direction(angle));
    if (!ray) return std::nullopt;
    const Vector3d side = ray->direction.dot(along) * across - ray->direction.dot(across) * along;
    return side.dot(point - ray->origin);
  };
  double before = 0.0;
  double angle = kFirstStep;
  auto miss_before = miss(before);
  for (int i = 0; miss_before && i < kIterations; ++i) {
    const auto now = miss(angle);
    if (!now) return std::nullopt;
    if (*now == *miss_before) return direction(angle);
    const double next = angle - *now * (angle - before) / (*now - *miss_before);
    before = angle;
    miss_before = now;
    angle = next;
    if (std::abs(angle - before) < 1e-13) return direction(angle);
  }
  return std::nullopt;
}

void check(const Port& port) {
  if (port.water_index < port.air_index || port.glass_index < port.air_index) {
    fail_input("water and glass must have an index of refraction of at least that of air");
  }
  if (port.kind == PortKind::flat && !(port.distance_m > 0.0)) {
    fail_input("distance_m must be positive: the lens center is in the air");
  }
  if (port.kind == PortKind::dome && !(port.center.norm() < port.radius_m)) {
    fail_input("the lens center is outside the dome: center_m is longer than radius_m");
  }
}

}  // namespace

Vector3d WaterRay::at(double distance, const Vector3d& center) const {
  const Vector3d from_center = origin - center;
  const double b = from_center.dot(direction);
  const double under_root = b * b - from_center.squaredNorm() + distance * distance;
  return origin + (std::sqrt(std::max(0.0, under_root)) - b) * direction;
}

PortCamera::PortCamera(const CameraModel& lens, const Port& port) : lens_(lens), port_(port) {
  check(port_);
  port_.normal.normalize();
}

std::optional<WaterRay> PortCamera::ray(const Vector2d& pixel) const {
  const auto in_air = lens_.unproject(pixel);
  return in_air ? trace(port_, *in_air) : std::nullopt;
}

std::optional<Vector2d> PortCamera::project(const Vector3d& point) const {
  const auto in_air =
      port_.kind == PortKind::flat ? aim_flat(port_, point) : aim_dome(port_, point);
  if (!in_air) return std::nullopt;
  // The line through a dome has a second side.
  const auto ray = trace(port_, in_air->normalized());
  if (!ray || (point - ray->origin).dot(ray->direction) < 0.0) return std::nullopt;
  return lens_.project(*in_air);
}

}  // namespace apvi
