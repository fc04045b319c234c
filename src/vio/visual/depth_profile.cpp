// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/depth_profile.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace apvi::vio {
namespace {

constexpr int kIterations = 5;

}  // namespace

DepthProfile::DepthProfile(const Landmark& landmark, const Window& window, double focal,
                           double max_error_px)
    : limit_(max_error_px / focal), focal_(focal) {
  const SE3 anchor = camera_pose(landmark.observations.front(), window);
  const Eigen::Vector3d first = ray(landmark.observations.front(), window);
  for (std::size_t k = 1; k < landmark.observations.size(); ++k) {
    const SE3 T = camera_pose(landmark.observations[k], window).inverse() * anchor;
    const Eigen::Vector3d seen = ray(landmark.observations[k], window);
    views_.push_back({T.rotation * first, T.translation, seen.head<2>()});
  }
}

double DepthProfile::least(double inverse_depth) const {
  const double from_infinity = descend(0.0);
  return inverse_depth > 0.0 ? std::min(from_infinity, descend(inverse_depth)) : from_infinity;
}

double DepthProfile::cost(double inverse_depth) const {
  double sum = 0.0;
  for (const View& view : views_) {
    const Eigen::Vector3d p = view.at(inverse_depth);
    const double error = p.z() > 0.0 ? (p.hnormalized() - view.seen).norm() : limit_;
    sum += std::min(error * error, limit_ * limit_);
  }
  return focal_ * focal_ * sum;
}

// Of Gauss-Newton, on the errors below the limit.
double DepthProfile::step(double inverse_depth) const {
  double slope = 0.0;
  double curvature = 0.0;
  for (const View& view : views_) {
    const Eigen::Vector3d p = view.at(inverse_depth);
    const Eigen::Vector2d error = p.hnormalized() - view.seen;
    if (!(p.z() > 0.0) || error.norm() >= limit_) continue;
    const Eigen::Vector2d J =
        (view.baseline.head<2>() - view.baseline.z() * p.hnormalized()) / p.z();
    slope += J.dot(error);
    curvature += J.squaredNorm();
  }
  return curvature > 0.0 ? -slope / curvature : 0.0;
}

double DepthProfile::descend(double inverse_depth) const {
  double least = cost(inverse_depth);
  for (int i = 0; i < kIterations; ++i) {
    inverse_depth = std::max(0.0, inverse_depth + step(inverse_depth));
    least = std::min(least, cost(inverse_depth));
  }
  return least;
}

}  // namespace apvi::vio
