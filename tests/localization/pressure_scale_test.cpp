// SPDX-License-Identifier: BSD-3-Clause
#include "localization/pressure_scale.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"

namespace apvi::localization {
namespace {

using Eigen::Vector3d;
using Path = std::function<Vector3d(double)>;

constexpr double kUnit_m = 2.5;
constexpr double kNoise_m = 0.01;

Rig rig() {
  Rig rig;
  rig.cameras.emplace_back();
  rig.cameras.front().T_body_camera.translation = {0.2, 0.0, 0.0};
  rig.depth = PressureDepthCalibration{.p_body_sensor = {-0.3, 0.1, 0.0}, .noise_m = kNoise_m};
  return rig;
}

// The scale after `duration_s` of a path of the camera in meters, with the poses turned by `tilt`
// and in units of kUnit_m.
std::optional<double> scale_of(const Path& path, double tilt_sigma, const Vector3d& tilt,
                               double duration_s = 20.0) {
  const Rig vehicle = rig();
  PressureScale scale(vehicle, tilt_sigma);
  Random random(1);
  const Vector3d camera = vehicle.cameras.front().T_body_camera.translation;
  std::optional<double> found;
  for (int k = 0; k * 0.05 < duration_s; ++k) {
    const double t = 0.05 * k;
    const Stamp stamp = Stamp{1'000'000'000} + Duration::from_seconds(t);
    const Eigen::Quaterniond R = so3::exp(Vector3d(0.0, 0.3 * std::sin(t), 0.1 * t));
    const Vector3d sensor = path(t) + R * (vehicle.depth->p_body_sensor - camera);
    scale.add({stamp, 10.0 - sensor.z() + random.normal(0.0, kNoise_m), kNoise_m});
    const Eigen::Quaterniond turn = so3::exp(tilt);
    const Vector3d position = turn * path(t) / kUnit_m - turn * R * camera;
    if (const auto now = scale.add({stamp, SE3{turn * R, position}})) found = now;
  }
  return found;
}

Vector3d in_all_directions(double t) {
  return {std::sin(0.7 * t), std::cos(0.5 * t), 0.6 * std::sin(0.9 * t)};
}

TEST(PressureScale, IsThatOfAPathInAllDirections) {
  const auto scale = scale_of(in_all_directions, 0.05, Vector3d::Zero());
  ASSERT_TRUE(scale);
  EXPECT_NEAR(*scale, kUnit_m, 0.02 * kUnit_m);
}

TEST(PressureScale, NeedsNoVerticalOnAPathInAllDirections) {
  const auto scale = scale_of(in_all_directions, 1.0, {0.5, -0.4, 0.0});
  ASSERT_TRUE(scale);
  EXPECT_NEAR(*scale, kUnit_m, 0.05 * kUnit_m);
}

TEST(PressureScale, IsThatOfAVerticalPathWithAKnownVertical) {
  const auto dive = [](double t) { return Vector3d(0.0, 0.0, -0.1 * t); };
  const auto scale = scale_of(dive, 0.05, Vector3d::Zero());
  ASSERT_TRUE(scale);
  EXPECT_NEAR(*scale, kUnit_m, 0.03 * kUnit_m);
}

TEST(PressureScale, StaysUnknownOnALineWithoutAVertical) {
  const auto dive = [](double t) { return Vector3d(0.2 * t, 0.0, -0.1 * t); };
  EXPECT_FALSE(scale_of(dive, 1.0, Vector3d::Zero()));
}

TEST(PressureScale, StaysUnknownAtConstantDepth) {
  const auto survey = [](double t) { return Vector3d(0.2 * t, std::sin(t), 0.0); };
  EXPECT_FALSE(scale_of(survey, 0.05, Vector3d::Zero()));
}

TEST(PressureScale, StaysUnknownOnASlopeThatAnErrorOfTheVerticalExplains) {
  const auto slope = [](double t) { return Vector3d(0.2 * t, 0.0, 0.02 * t); };
  EXPECT_FALSE(scale_of(slope, 0.05, Vector3d::Zero()));
}

}  // namespace
}  // namespace apvi::localization
