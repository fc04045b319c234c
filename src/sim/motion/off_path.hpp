// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/se3.hpp"
#include "sim/render/ray_caster.hpp"

namespace apvi::sim {

/// Images from beside the path, for the evaluation of maps: the vehicle never was there.
struct OffPathConfig {
  double aside_m = 1.0;
  double turn_deg = 30.0;

  template <typename V>
  void visit(V& v) {
    v("aside_m", aside_m, config::Range{0.0, 100.0},
      "distance from the camera, to its right or left [m]; 0: no such images");
    v("turn_deg", turn_deg, config::Range{-90.0, 90.0},
      "turn back toward what the camera sees [deg]");
  }
};

/// T_camera_view of the image beside a camera at `T_world_camera`: to the right, or to the left if
/// `left_first` or the right is blocked. Nothing if the scene leaves no room on either side.
std::optional<SE3> off_path_view(const SE3& T_world_camera, const OffPathConfig& config,
                                 bool left_first, const RayCaster& world);

/// The content of truth/off_path/<stamp>.json.
std::string off_path_json(const SE3& T_camera_view);

}  // namespace apvi::sim
