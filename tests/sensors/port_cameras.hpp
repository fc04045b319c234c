// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/port.hpp"

/// Cameras behind ports.
namespace apvi::test {

inline CameraModel lens_in_air() {
  return CameraModel({.fx = 300.0,
                      .fy = 301.0,
                      .cx = 318.0,
                      .cy = 241.0,
                      .distortion = Distortion::radtan,
                      .coefficients = {-0.05, 0.01, 2e-4, -1e-4},
                      .width = 640,
                      .height = 480});
}

inline Port flat_port(double distance_m = 0.05, double tilt_rad = 0.0) {
  return {.glass_thickness_m = 0.008,
          .normal =
              so3::exp(Eigen::Vector3d(tilt_rad, -0.5 * tilt_rad, 0.0)) * Eigen::Vector3d::UnitZ(),
          .distance_m = distance_m};
}

inline Port dome_port(const Eigen::Vector3d& center) {
  return {.kind = PortKind::dome, .glass_thickness_m = 0.006, .radius_m = 0.06, .center = center};
}

}  // namespace apvi::test
