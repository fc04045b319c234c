// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/local_origin.hpp"

#include <torch/torch.h>

#include <cmath>
#include <utility>

namespace apvi::runs {
namespace {

constexpr double kFar_m = 1000.0;
constexpr double kRounding_m = 100.0;  // so that maps of one place have the same origin

Eigen::Vector3d vector(const map_io::Origin& origin) {
  return {origin[0], origin[1], origin[2]};
}

}  // namespace

map_io::Origin local_origin(const Trajectory& poses) {
  if (poses.empty()) return {};
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const StampedPose& pose : poses.poses) sum += pose.T_world_body.translation;
  const Eigen::Vector3d center = sum / static_cast<double>(poses.size());
  if (!(center.norm() > kFar_m) || !center.allFinite()) return {};
  const auto rounded = [](double x) { return kRounding_m * std::round(x / kRounding_m) + 0.0; };
  return {rounded(center.x()), rounded(center.y()), rounded(center.z())};
}

Trajectory to_local(Trajectory poses, const map_io::Origin& origin) {
  if (map_io::is_zero(origin)) return poses;
  for (StampedPose& pose : poses.poses) pose.T_world_body.translation -= vector(origin);
  return poses;
}

Trajectory to_recording(Trajectory poses, const map_io::Origin& origin) {
  return to_local(std::move(poses), {-origin[0], -origin[1], -origin[2]});
}

torch::Tensor to_local(const torch::Tensor& T_camera_world, const map_io::Origin& origin) {
  if (map_io::is_zero(origin)) return T_camera_world;
  torch::Tensor T_world_local = torch::eye(4, torch::kFloat64);
  for (std::int64_t i = 0; i < 3; ++i) T_world_local[i][3] = origin[static_cast<std::size_t>(i)];
  return T_camera_world.mm(T_world_local);
}

torch::Tensor rebased(const torch::Tensor& means, const map_io::Origin& from,
                      const map_io::Origin& to) {
  const torch::Tensor shift =
      torch::tensor({from[0] - to[0], from[1] - to[1], from[2] - to[2]}, torch::kFloat64);
  return (means.to(torch::kFloat64) + shift.to(means.device())).to(means.scalar_type());
}

}  // namespace apvi::runs
