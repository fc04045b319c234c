// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "apvi/core/constants.hpp"
#include "doctor/camera_scene.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Vector3d;
using test::CameraScene;

// The fit, from a rig that knows nothing unless it is given.
CameraGyroFit fit(const CameraScene& scene, const CameraModel& lens,
                  const CameraGyroModel& rig = {}) {
  const InertialPath path(scene.imu());
  const auto found = fit_camera_against_gyro(CameraGyroProblem(path, scene.pairs(), lens), rig);
  EXPECT_TRUE(found.has_value());
  return found.value_or(CameraGyroFit{});
}

CameraGyroFit fit(const CameraScene& scene) {
  return fit(scene, CameraModel(scene.lens));
}

double angle_off(const CameraGyroModel& model, const CameraScene& scene) {
  return so3::angle_between(model.R_camera_body, scene.T_body_camera.rotation.conjugate());
}

void expect_truth(const CameraGyroFit& found, const CameraScene& scene) {
  EXPECT_NEAR(found.model.time_offset_s, scene.time_offset_s,
              std::max(0.002, 4.0 * found.sigma(kTimeOffset)));
  EXPECT_LT(found.sigma(kTimeOffset), 0.003);
  EXPECT_LT(angle_off(found.model, scene), 0.5 * kRadiansPerDegree);
  EXPECT_GT(found.uniqueness, 4.0);
}

TEST(CameraGyroFit, FindsTimeOffsetAndRotationFromNothing) {
  const CameraScene scene;
  const CameraGyroFit found = fit(scene);
  expect_truth(found, scene);
  EXPECT_NEAR(found.model.gyro_scale, 1.0, 0.01);
  EXPECT_NEAR(found.lens_model.focal, 1.0, 0.01);
  EXPECT_LT(found.lens_gain, 4.0);
  EXPECT_NEAR(found.rms_px, scene.noise_px, 0.1);
}

TEST(CameraGyroFit, AFlatSceneIsNoSpecialCase) {
  CameraScene scene;
  scene.is_flat = true;
  scene.time_offset_s = -0.4;
  expect_truth(fit(scene), scene);
}

TEST(CameraGyroFit, MirroredImagesTurnAsACameraThatLooksTheOtherWay) {
  CameraScene scene;
  const CameraGyroModel truth = fit(scene).model;
  std::vector<ImagePair> pairs = scene.pairs();
  for (ImagePair& pair : pairs) {
    for (PixelPair& point : pair.points) {
      point.before.x() = scene.lens.width - 1.0 - point.before.x();
      point.now.x() = scene.lens.width - 1.0 - point.now.x();
    }
  }
  const InertialPath path(scene.imu());
  const auto found = fit_camera_against_gyro(
      CameraGyroProblem(path, std::move(pairs), CameraModel(scene.lens)), truth);
  ASSERT_TRUE(found.has_value());
  const Eigen::Quaterniond half_turn(0.0, 1.0, 0.0, 0.0);
  EXPECT_LT(so3::angle_between(found->model.R_camera_body, half_turn * truth.R_camera_body),
            0.5 * kRadiansPerDegree);
}

TEST(CameraGyroFit, TellsTheGyroScaleFromTheFocalLength) {
  CameraScene scene;
  scene.change_imu = [](ImuSample& sample) { sample.gyro *= 1.7; };
  const CameraGyroFit found = fit(scene);
  expect_truth(found, scene);
  EXPECT_NEAR(found.model.gyro_scale, 1.0 / 1.7, 0.01);
  EXPECT_NEAR(found.lens_model.gyro_scale, 1.0 / 1.7, 0.01);
  EXPECT_NEAR(found.lens_model.focal, 1.0, 0.015);
}

TEST(CameraGyroFit, FindsTheFocalLength) {
  const CameraScene scene;
  CameraModel::Parameters wrong = scene.lens;
  wrong.fx *= 1.05;
  wrong.fy *= 1.05;
  const CameraGyroFit found = fit(scene, CameraModel(wrong));
  EXPECT_NEAR(found.lens_model.focal, 1.0 / 1.05, 0.01);
  EXPECT_NEAR(found.lens_model.gyro_scale, 1.0, 0.01);
  EXPECT_GT(found.lens_gain, 4.0);
}

TEST(CameraGyroFit, FindsMissingDistortion) {
  CameraScene scene;
  scene.lens.coefficients = {-0.2, 0.0, 0.0, 0.0};
  CameraModel::Parameters wrong = scene.lens;
  wrong.distortion = Distortion::none;
  wrong.coefficients = {};
  const CameraGyroFit found = fit(scene, CameraModel(wrong));
  EXPECT_NEAR(found.lens_model.radial, -0.2, 0.02);
  EXPECT_NEAR(found.lens_model.focal, 1.0, 0.01);
  EXPECT_GT(found.lens_gain, 4.0);
}

TEST(CameraGyroFit, LeftHandedGyroAxesHaveANegativeScale) {
  CameraScene scene;
  scene.change_imu = [](ImuSample& sample) { sample.gyro.y() *= -1.0; };
  EXPECT_NEAR(fit(scene).model.gyro_scale, -1.0, 0.02);
}

TEST(CameraGyroFit, WithoutTurnsNothingIsUnique) {
  CameraScene scene;
  scene.spline = test::wavy_spline(3, 60.0, 0.0);
  EXPECT_LT(fit(scene).uniqueness, 3.0);
}

TEST(CameraGyroFit, NeedsTwentyPairs) {
  const CameraScene scene;
  std::vector<ImagePair> pairs = scene.pairs();
  pairs.resize(19);
  const InertialPath path(scene.imu());
  EXPECT_FALSE(fit_camera_against_gyro(
                   CameraGyroProblem(path, std::move(pairs), CameraModel(scene.lens)), {})
                   .has_value());
}

TEST(TurningSpans, AreWhereTheVehicleTurns) {
  std::vector<ImuSample> samples;
  for (int i = 0; i < 6000; ++i) {
    const double t = 0.01 * i;
    ImuSample sample{Stamp{} + Duration::from_seconds(t), Vector3d::Zero(), {0.0, 0.0, 9.8}};
    if (t > 20.0 && t < 24.0) sample.gyro.z() = 0.3;
    if (t > 40.0 && t < 43.0) sample.gyro.x() = 0.1;
    samples.push_back(sample);
  }
  const InertialPath path(samples);
  const auto spans = turning_spans(path, {samples.front().stamp, samples.back().stamp}, 2);
  ASSERT_EQ(spans.size(), 2u);
  EXPECT_NEAR(path.seconds(spans[0].from), 22.0, 3.0);
  EXPECT_NEAR(path.seconds(spans[1].from), 40.5, 2.0);
}

}  // namespace
}  // namespace apvi::doctor
