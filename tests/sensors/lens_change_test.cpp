// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/lens_change.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace apvi {
namespace {

using Change = std::array<double, 3>;

CameraModel camera_with(Distortion distortion, const CameraModel::Coefficients& coefficients) {
  return CameraModel({.fx = 200.0,
                      .fy = 210.0,
                      .cx = 160.0,
                      .cy = 118.0,
                      .distortion = distortion,
                      .coefficients = coefficients,
                      .width = 320,
                      .height = 240});
}

CameraModel changed(const CameraModel& camera, const Change& change) {
  CameraModel::Parameters p = camera.parameters();
  p.cx += change[1] * p.fx;
  p.cy += change[2] * p.fy;
  p.fx *= std::exp(change[0]);
  p.fy *= std::exp(change[0]);
  return CameraModel(p);
}

// Largest error in pixels of the true point, over the image.
double largest_error(const CameraModel& camera, const Change& change, bool with_distortion) {
  const CameraModel truth = changed(camera, change);
  double largest = 0.0;
  for (int x = 0; x < 320; x += 20) {
    for (int y = 0; y < 240; y += 20) {
      const Eigen::Vector2d point = camera.unproject({x, y})->hnormalized();
      const Eigen::Vector2d expected = truth.unproject({x, y})->hnormalized();
      const DistortionByLens distortion =
          with_distortion ? distortion_by_lens(camera, point) : DistortionByLens::Zero();
      const Eigen::Vector2d found = true_point(point, distortion, change.data());
      largest = std::max(largest, 200.0 * (found - expected).norm());
    }
  }
  return largest;
}

constexpr Change kSmall{0.01, 0.004, -0.005};

TEST(LensChange, IsExactWithoutDistortion) {
  const CameraModel camera = camera_with(Distortion::none, {});
  EXPECT_LT(largest_error(camera, {0.05, 0.02, -0.03}, true), 1e-9);
}

TEST(LensChange, FollowsRadialDistortion) {
  const CameraModel camera = camera_with(Distortion::radtan, {-0.11, 0.035, 4e-4, -3e-4});
  EXPECT_LT(largest_error(camera, kSmall, true), 0.01);
  EXPECT_GT(largest_error(camera, kSmall, false), 0.2) << "what distortion matters";
}

TEST(LensChange, FollowsAFisheyeLens) {
  const CameraModel camera = camera_with(Distortion::equidistant, {0.01, -0.002});
  EXPECT_LT(largest_error(camera, kSmall, true), 0.2);
  EXPECT_GT(largest_error(camera, kSmall, false), 1.0) << "what distortion matters";
}

TEST(LensChange, ThereAndBackIsThePoint) {
  const CameraModel camera = camera_with(Distortion::radtan, {-0.11, 0.035, 4e-4, -3e-4});
  const Eigen::Vector2d point(0.4, -0.3);
  const DistortionByLens distortion = distortion_by_lens(camera, point);
  const Eigen::Vector2d by_rig = rig_point(point, distortion, kSmall.data());
  EXPECT_LT((true_point(by_rig, distortion, kSmall.data()) - point).norm(), 1e-12);
}

}  // namespace
}  // namespace apvi
