// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/calibration.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "support/simulated_dive.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector3d;

Rig stereo_rig() {
  Rig rig = test::SimulatedDive::rig();
  rig.cameras.push_back(rig.cameras.front());
  rig.cameras.back().T_body_camera.translation.y() -= 0.1;
  return rig;
}

const CalibrationParameter& named(const std::vector<CalibrationParameter>& all,
                                  const std::string& name) {
  for (const CalibrationParameter& p : all) {
    if (p.name == name) return p;
  }
  throw std::out_of_range(name);
}

TEST(Calibration, StartsWithTheRigAndItsUncertainty) {
  const Rig rig = stereo_rig();
  Calibration calibration = calibration_of(rig);
  const CalibrationConfig config;
  const Prior prior = calibration_prior(calibration, config);
  const auto all = estimate_of(calibration, rig, config, prior).parameters;
  ASSERT_EQ(all.size(), 12U);
  for (const CalibrationParameter& p : all) {
    EXPECT_TRUE(p.change.isZero(1e-12)) << p.name;
    EXPECT_TRUE(p.sigma.isApproxToConstant(p.prior_sigma, 1e-9)) << p.name;
    EXPECT_FALSE(p.observable()) << p.name;
  }
  EXPECT_EQ(named(all, "cam1.lever_arm").prior_sigma, config.camera_lever_arm.sigma);
  EXPECT_EQ(named(all, "dvl0.scale").prior_sigma, config.dvl_scale.sigma);
}

TEST(Calibration, OmitsWhatIsNotEstimatedAndADvlThatIsNotThere) {
  Rig rig = stereo_rig();
  rig.dvl.reset();
  Calibration calibration = calibration_of(rig);
  CalibrationConfig config = CalibrationConfig::fixed();
  const CalibrationEstimate none =
      estimate_of(calibration, rig, config, calibration_prior(calibration, config));
  EXPECT_TRUE(none.parameters.empty());
  EXPECT_EQ(none.covariance.size(), 0);
  config.camera_mounting.estimate = config.dvl_scale.estimate = true;
  const auto all =
      estimate_of(calibration, rig, config, calibration_prior(calibration, config)).parameters;
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].name, "cam0.mounting");
  EXPECT_EQ(all[1].name, "cam1.mounting");
}

TEST(Calibration, ChangesTheRigSoThatPixelsAgree) {
  Rig rig = stereo_rig();
  Calibration calibration = calibration_of(rig);
  calibration.lenses[0] = {std::log(1.02), 0.01, -0.02};
  calibration.dvl_log_scale = std::log(0.99);
  calibration.camera_time_offset_s = 0.03;
  const Rig changed = calibrated(rig, calibration);
  const Vector3d truth(0.3, -0.2, 1.0);
  const Eigen::Vector2d pixel = *changed.cameras[0].model.project(truth);
  const Eigen::Vector2d by_rig = rig.cameras[0].model.unproject(pixel)->hnormalized();
  EXPECT_LT((true_point(by_rig, calibration.lenses[0]) - truth.head<2>()).norm(), 1e-9);
  EXPECT_DOUBLE_EQ(changed.dvl->scale, 0.99 * rig.dvl->scale);
  EXPECT_DOUBLE_EQ(changed.cameras[0].time_offset_s, 0.03);
}

TEST(Calibration, IsRecoveredFromTheChangesOfItsParameters) {
  const Rig rig = stereo_rig();
  Calibration calibration = calibration_of(rig);
  const CalibrationConfig config;
  const Prior prior = calibration_prior(calibration, config);
  const SE3 turn{so3::exp(Vector3d(0.02, -0.01, 0.03)), Vector3d(0.01, 0.02, -0.03)};
  calibration.T_body_camera[1] = to_block(to_se3(calibration.T_body_camera[1].data()) * turn);
  calibration.T_body_dvl = to_block(to_se3(calibration.T_body_dvl.data()) * turn);
  calibration.lenses[0] = {std::log(1.02), 0.01, -0.02};
  calibration.camera_time_offset_s = 0.04;
  calibration.dvl_log_scale = -0.01;
  const CalibrationEstimate found = estimate_of(calibration, rig, config, prior);
  const Calibration again = with_changes(rig, found.parameters);
  for (int k = 0; k < kPoseSize; ++k) {
    EXPECT_NEAR(again.T_body_camera[1][k], calibration.T_body_camera[1][k], 1e-12);
    EXPECT_NEAR(again.T_body_dvl[k], calibration.T_body_dvl[k], 1e-12);
  }
  for (int k = 0; k < kLensSize; ++k)
    EXPECT_NEAR(again.lenses[0][k], calibration.lenses[0][k], 1e-12);
  EXPECT_EQ(again.camera_time_offset_s, 0.04);
  EXPECT_NEAR(again.dvl_log_scale, -0.01, 1e-12);
}

TEST(CalibrationEstimate, CovarianceIsThatOfTheComponentsInOrder) {
  const Rig rig = test::SimulatedDive::rig();
  CalibrationConfig config = CalibrationConfig::fixed();
  config.camera_lever_arm = {.estimate = true, .sigma = 0.03};
  config.dvl_scale = {.estimate = true, .sigma = 0.01};
  Calibration calibration = calibration_of(rig);
  Prior prior = calibration_prior(calibration, config);
  const Eigen::Index scale = prior.J.cols() - 1;
  prior.J(scale, 4) = 7.0;  // the y of the lever arm
  const Eigen::MatrixXd all = (prior.J.transpose() * prior.J).inverse();
  const Eigen::MatrixXd found = estimate_of(calibration, rig, config, prior).covariance;
  ASSERT_EQ(found.rows(), 4);
  EXPECT_NEAR(found(1, 3), all(4, scale), 1e-12);
  EXPECT_NEAR(found(3, 3), all(scale, scale), 1e-12);
  EXPECT_NEAR(found(0, 0), 9e-4, 1e-12);
}

TEST(CalibrationEstimate, IsTheMinimumOfTheKnowledge) {
  const Rig rig = test::SimulatedDive::rig();
  CalibrationConfig config = CalibrationConfig::fixed();
  config.dvl_scale = {.estimate = true, .sigma = 0.01};
  Calibration calibration = calibration_of(rig);
  Prior prior = calibration_prior(calibration, config);
  prior.r(prior.r.size() - 1) = -0.5;  // half a sigma above the value in use
  const CalibrationEstimate found = estimate_of(calibration, rig, config, prior);
  ASSERT_EQ(found.parameters.size(), 1U);
  EXPECT_NEAR(found.parameters.front().change(0), 0.005, 1e-12);
}

TEST(CalibrationPart, IsTheMarginalOfAJointPrior) {
  const Rig rig = test::SimulatedDive::rig();
  CalibrationConfig config = CalibrationConfig::fixed();
  config.dvl_scale = {.estimate = true, .sigma = 0.01};
  Calibration calibration = calibration_of(rig);
  const auto parts = blocks(calibration, config);
  double state = 0.0;
  // scale ~ N(0, 0.01), state - 2 scale ~ N(0, 0.1), state ~ N(0, 0.05)
  auto joint = std::make_shared<Prior>(calibration_prior(calibration, config));
  joint->kept.push_back({{&state, 1}, {0.0}});
  joint->J = (Eigen::MatrixXd(3, 2) << 100.0, 0.0, -20.0, 10.0, 0.0, 20.0).finished();
  joint->r = Eigen::Vector3d::Zero();
  const Prior part = calibration_part(joint, parts);
  ASSERT_EQ(part.kept.size(), 1U);
  const double variance = (joint->J.transpose() * joint->J).inverse()(0, 0);
  EXPECT_NEAR((part.J.transpose() * part.J)(0, 0), 1.0 / variance, 1e-6 / variance);
}

TEST(CalibrationPart, IsEmptyIfAnEstimatedBlockIsUnknown) {
  const Rig rig = test::SimulatedDive::rig();
  Calibration calibration = calibration_of(rig);
  CalibrationConfig config = CalibrationConfig::fixed();
  config.dvl_scale.estimate = true;
  const auto known = std::make_shared<Prior>(calibration_prior(calibration, config));
  config.focal_length.estimate = true;
  EXPECT_TRUE(calibration_part(known, blocks(calibration, config)).kept.empty());
  EXPECT_TRUE(calibration_part(nullptr, blocks(calibration, config)).kept.empty());
}

TEST(CalibrationMemory, ForgetsTheLastSeconds) {
  const Rig rig = test::SimulatedDive::rig();
  CalibrationConfig config = CalibrationConfig::fixed();
  config.dvl_scale.estimate = true;
  Calibration calibration = calibration_of(rig);
  const auto parts = blocks(calibration, config);
  CalibrationMemory memory(calibration, config);
  const auto learn = [&](double second, double scale) {
    calibration.dvl_log_scale = scale;
    const auto prior = std::make_shared<Prior>(calibration_prior(calibration, config));
    memory.update(Stamp{} + Duration::from_seconds(second), prior, calibration, parts);
  };
  learn(0.0, 0.001);
  learn(6.0, 0.002);
  learn(8.0, 0.5);  // too soon
  memory.restore(calibration);
  EXPECT_EQ(calibration.dvl_log_scale, 0.001);
  ASSERT_EQ(memory.knowledge().kept.size(), 1U);
  EXPECT_EQ(memory.knowledge().kept[0].block.data, &calibration.dvl_log_scale);
}

}  // namespace
}  // namespace apvi::vio
