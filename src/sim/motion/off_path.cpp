// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/off_path.hpp"

#include <nlohmann/json.hpp>
#include <numbers>
#include <vector>

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr double kRoom_m = 0.3;  // between the view and the scene, to the side and ahead

// Right is positive. The view turns about the image's vertical axis, back toward the camera's.
SE3 aside(const OffPathConfig& config, double side) {
  const double angle = -side * config.turn_deg * std::numbers::pi / 180.0;
  return {Eigen::Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitY())),
          Vector3d(side * config.aside_m, 0.0, 0.0)};
}

bool has_room(const SE3& T_world_camera, const SE3& T_camera_view, const RayCaster& world) {
  const Vector3d way = T_world_camera.rotation * T_camera_view.translation;
  const double length = way.norm();
  if (world.cast(T_world_camera.translation, way / length, length + kRoom_m)) return false;
  const SE3 view = T_world_camera * T_camera_view;
  return !world.cast(view.translation, view.rotation * Vector3d::UnitZ(), kRoom_m);
}

}  // namespace

std::optional<SE3> off_path_view(const SE3& T_world_camera, const OffPathConfig& config,
                                 bool left_first, const RayCaster& world) {
  if (config.aside_m <= 0.0) return std::nullopt;
  const double first = left_first ? -1.0 : 1.0;
  for (const double side : {first, -first}) {
    const SE3 view = aside(config, side);
    if (has_room(T_world_camera, view, world)) return view;
  }
  return std::nullopt;
}

std::string off_path_json(const SE3& T_camera_view) {
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> T = T_camera_view.matrix();
  const std::vector<double> rows(T.data(), T.data() + T.size());
  return nlohmann::ordered_json{{"T_camera_view", rows}}.dump(2) + "\n";
}

}  // namespace apvi::sim
