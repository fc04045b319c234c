// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/ray_intersection.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>

namespace apvi::loop_closure {
namespace {

constexpr double kMaxDistance_m = 1e3;

}  // namespace

double parallax(const MapRay& own, const std::vector<MapRay>& others) {
  double largest = 0.0;
  for (const MapRay& other : others) {
    largest = std::max(largest, own.direction.cross(other.direction).norm());
  }
  return largest;
}

Eigen::Vector3d nearest_point(const std::vector<MapRay>& rays) {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  for (const bool weighted : {false, true}) {
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (const MapRay& ray : rays) {
      const double weight = weighted ? 1.0 / (point - ray.origin).squaredNorm() : 1.0;
      const Eigen::Matrix3d across =
          weight * (Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose());
      A += across;
      b += across * ray.origin;
    }
    point = A.ldlt().solve(b);
  }
  return point;
}

bool fits(const Eigen::Vector3d& point, const std::vector<MapRay>& rays, double tolerance) {
  return std::ranges::all_of(rays, [&](const MapRay& ray) {
    const Eigen::Vector3d offset = point - ray.origin;
    const double along = offset.dot(ray.direction);
    return along > 0.0 && along < kMaxDistance_m &&
           offset.cross(ray.direction).norm() < tolerance * along;
  });
}

}  // namespace apvi::loop_closure
