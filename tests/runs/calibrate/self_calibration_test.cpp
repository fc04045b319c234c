// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/self_calibration.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

config::Node rig_node() {
  return config::parse_yaml(R"(
imu0: {rate_hz: 200}
cam0:
  intrinsics: [400, 410, 320, 240]
  distortion: radtan
  coefficients: [-0.1, 0.03, 0.001, -0.001]
  resolution: [640, 480]
  T_body_sensor: [0, 0, 1, 0.1, -1, 0, 0, 0, 0, -1, 0, 0.05, 0, 0, 0, 1]
dvl0:
  T_body_sensor: [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, -0.1, 0, 0, 0, 1]
  assumed_sound_speed: 1475
)",
                            "rig.yaml");
}

TEST(EstimatedRig, IsReadAsTheRigThatWasEstimated) {
  const config::Node node = rig_node();
  Rig estimate = make_rig(node);
  CameraCalibration& camera = estimate.cameras.front();
  CameraModel::Parameters lens = camera.model.parameters();
  lens.fx = 404.25;
  lens.cy = 238.5;
  camera.model = CameraModel(lens);
  camera.T_body_camera.translation.x() = 0.125;
  camera.T_body_camera.rotation *= Eigen::Quaterniond(0.999, 0.01, -0.02, 0.03).normalized();
  camera.time_offset_s = 0.0375;
  estimate.dvl->scale = 1.0125;
  estimate.dvl->time_offset_s = 0.1;
  const Rig read = make_rig(estimated_rig(node, estimate));
  EXPECT_EQ(read.cameras[0].model.parameters().fx, 404.25);
  EXPECT_EQ(read.cameras[0].model.parameters().cy, 238.5);
  EXPECT_EQ(read.cameras[0].model.parameters().coefficients, lens.coefficients);
  EXPECT_EQ(read.cameras[0].time_offset_s, 0.0375);
  EXPECT_LT((read.cameras[0].T_body_camera.translation - camera.T_body_camera.translation).norm(),
            1e-8);
  EXPECT_LT(read.cameras[0].T_body_camera.rotation.angularDistance(camera.T_body_camera.rotation),
            1e-7);
  EXPECT_NEAR(read.dvl->scale, 1.0125, 1e-8);
  EXPECT_EQ(read.dvl->time_offset_s, 0.1);
  EXPECT_EQ(read.imu->rate_hz, 200.0);
}

TEST(ChangedRig, HasTheTimeOffsetOfTheDvlOnce) {
  Rig rig = make_rig(rig_node());
  rig.dvl->time_offset_s = 0.1;
  vio::CalibrationEstimate estimate{{{"dvl0.scale", Eigen::VectorXd::Constant(1, 0.02),
                                      Eigen::VectorXd::Constant(1, 0.001), 0.01}},
                                    Eigen::MatrixXd::Constant(1, 1, 1e-6)};
  append_time_offset({.value_s = 0.15, .sigma_s = 0.002}, 0.1, 0.1, estimate);
  const Rig now = changed(rig, estimate.parameters);
  EXPECT_DOUBLE_EQ(now.dvl->time_offset_s, 0.15);
  EXPECT_DOUBLE_EQ(now.dvl->scale, 1.02 * rig.dvl->scale);
  EXPECT_TRUE(estimate.parameters.back().observable());
  EXPECT_EQ(estimate.covariance, (Eigen::Matrix2d{{1e-6, 0.0}, {0.0, 4e-6}}));
}

TEST(SelfCalibrationReport, WritesHeldParametersAsTheRigHasThem) {
  const test::TmpDir folder;
  const auto number = [](double value) { return Eigen::VectorXd::Constant(1, value); };
  const std::filesystem::path file = folder.path() / "rig_estimated.yaml";
  report_self_calibration(file, rig_node(),
                          {{"cam0.focal_length", number(0.02), number(1e-3), 0.01, /*held=*/true},
                           {"cam0.time_offset_s", number(0.03), number(1e-3), 0.05}});
  const Rig written = make_rig(config::load_file(file));
  EXPECT_NEAR(written.cameras[0].model.parameters().fx, 400.0, 1e-9);
  EXPECT_NEAR(written.cameras[0].time_offset_s, 0.03, 1e-9);
}

TEST(SelfCalibrationJson, SaysWhatTheRecordingTold) {
  const Eigen::Vector3d turned(0.01, 0.0, -0.02);
  const Eigen::VectorXd scale = Eigen::VectorXd::Constant(1, 0.002);
  const eval::Json json =
      self_calibration_json({{"cam0.mounting", turned, Eigen::Vector3d(1e-3, 2e-3, 1e-3), 0.02},
                             {"dvl0.scale", scale, Eigen::VectorXd::Constant(1, 0.0099), 0.01}});
  EXPECT_EQ(json["cam0.mounting"]["change"], (std::vector<double>{0.01, 0.0, -0.02}));
  EXPECT_EQ(json["cam0.mounting"]["observable"], true);
  EXPECT_EQ(json["dvl0.scale"]["change"], 0.002);
  EXPECT_EQ(json["dvl0.scale"]["observable"], false);
  EXPECT_EQ(json["dvl0.scale"]["held"], false);
}

}  // namespace
}  // namespace apvi::runs
