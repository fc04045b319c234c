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
  const auto all = parameters(calibration, rig, config, prior);
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
  EXPECT_TRUE(parameters(calibration, rig, config, calibration_prior(calibration, config)).empty());
  config.camera_mounting.estimate = config.dvl_scale.estimate = true;
  const auto all = parameters(calibration, rig, config, calibration_prior(calibration, config));
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
