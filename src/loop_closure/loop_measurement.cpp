// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/loop_measurement.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

// The nearest pose that leaves the vertical as it is, equal at a point.
SE3 level(const SE3& pose, const Eigen::Vector3d& at) {
  const Eigen::Quaterniond R = so3::exp({0.0, 0.0, so3::yaw(pose.rotation)});
  return {R, pose * at - R * at};
}

EdgeSigmas sigmas_of(const Eigen::Matrix4d& covariance) {
  const Eigen::Vector4d sigmas = covariance.diagonal().cwiseSqrt();
  return {.heading_rad = std::hypot(kLoopSigmas.heading_rad, sigmas[3]),
          .horizontal_m = std::hypot(kLoopSigmas.horizontal_m, std::max(sigmas[0], sigmas[1])),
          .vertical_m = std::hypot(kLoopSigmas.vertical_m, sigmas[2])};
}

}  // namespace

std::optional<Loop> measure_loop(const KeyframeGraph& graph, std::size_t from, std::size_t to,
                                 const PlaceMatch& match, double ray_sigma) {
  const SE3& T_world_then = graph[from].T_world_camera;
  LevelView view{graph[to].T_world_camera, match.seen};
  if (view.seen.empty()) return std::nullopt;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (PointOnRay& seen : view.seen) {
    seen.point = T_world_then * seen.point;
    center += seen.point / static_cast<double>(view.seen.size());
  }
  const SE3 T_now_then = view.T_world_camera * match.T_now_then * T_world_then.inverse();
  const auto fitted = fit_level_pose({view}, level(T_now_then, center), ray_sigma);
  if (!fitted) return std::nullopt;
  return Loop{from, to,
              T_world_then.inverse() * fitted->T_world_map.inverse() * graph[to].T_world_camera,
              sigmas_of(fitted->covariance)};
}

}  // namespace apvi::loop_closure
