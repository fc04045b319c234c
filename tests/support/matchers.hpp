// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gmock/gmock.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "apvi/geometry/se3.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::test {

MATCHER_P2(MatrixNear, expected, tolerance, "") {
  const double distance = (arg - expected).norm();
  *result_listener << "differs by " << distance << ":\n" << arg << "\nagainst\n" << expected;
  return distance <= tolerance;
}

MATCHER_P2(RotationNear, expected, tolerance, "") {
  const double angle = so3::angle_between(arg, expected);
  *result_listener << "differs by " << angle << " rad";
  return angle <= tolerance;
}

MATCHER_P2(PoseNear, expected, tolerance, "") {
  const double angle = so3::angle_between(arg.rotation, expected.rotation);
  const double distance = (arg.translation - expected.translation).norm();
  *result_listener << "differs by " << angle << " rad and " << distance << " m";
  return angle <= tolerance && distance <= tolerance;
}

}  // namespace apvi::test
