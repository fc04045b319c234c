// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

namespace apvi::loop_closure {

/// A ray in the frame of a map.
struct MapRay {
  Eigen::Vector3d origin, direction;  ///< [m], unit vector
};

/// Largest sine of the angle between a ray and the others.
double parallax(const MapRay& own, const std::vector<MapRay>& others);

/// The point with the least squared distance to the rays, each divided by the distance from its
/// origin: one step of reweighting, as the errors are angles.
Eigen::Vector3d nearest_point(const std::vector<MapRay>& rays);

/// Whether the point lies before every origin, within 1 km, and no more than `tolerance` [rad]
/// beside every ray.
bool fits(const Eigen::Vector3d& point, const std::vector<MapRay>& rays, double tolerance);

}  // namespace apvi::loop_closure
