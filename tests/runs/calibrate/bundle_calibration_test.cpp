// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/bundle_calibration.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "apvi/geometry/so3.hpp"

namespace apvi::runs {
namespace {

constexpr Eigen::Index kDvl = 4;  // components of the DVL below, after those of the camera

Rig one_camera() {
  Rig rig;
  rig.cameras.resize(1);
  rig.cameras[0].T_body_camera = {so3::exp({0.3, -0.2, 1.0}), {0.1, 0.2, 0.3}};
  return rig;
}

// Mounting and focal length of the camera, and the mounting of the DVL, which turns with it.
vio::CalibrationEstimate window_estimate() {
  vio::CalibrationEstimate estimate;
  estimate.parameters = {
      {"cam0.mounting", Eigen::Vector3d(0.01, 0.0, -0.01), Eigen::Vector3d::Zero(), 0.02},
      {"cam0.focal_length", Eigen::VectorXd::Constant(1, 0.004), Eigen::VectorXd::Zero(1), 0.01},
      {"dvl0.mounting", Eigen::Vector3d(0.02, 0.01, 0.0), Eigen::Vector3d::Zero(), 0.02}};
  Eigen::MatrixXd root = Eigen::MatrixXd::Identity(7, 7) * 1e-3;
  root.bottomLeftCorner<3, 3>() = 2e-3 * Eigen::Matrix3d::Identity();
  root(5, 3) = -1e-3;
  estimate.covariance = root * root.transpose();
  return estimate;
}

loop_closure::BundleCamera adjusted(const Eigen::Vector3d& mounting, double focal_length) {
  const SE3 rig = one_camera().cameras[0].T_body_camera;
  loop_closure::BundleCamera camera;
  camera.T_body_camera = {rig.rotation * so3::exp(mounting), rig.translation};
  camera.lens.scale = 1.0 + focal_length;
  return camera;
}

TEST(AdoptCamera, GivesTheOthersTheirMeanUnderTheConditionOfTheCamera) {
  vio::CalibrationEstimate estimate = window_estimate();
  const Eigen::MatrixXd information = estimate.covariance.inverse();
  adopt_camera(adjusted({0.012, 0.001, -0.01}, 0.005), one_camera(), estimate);
  Eigen::Vector4d moved;
  moved << 0.002, 0.001, 0.0, 0.001;
  const Eigen::Matrix3d of_dvl = information.bottomRightCorner<3, 3>().inverse();
  const Eigen::Vector3d expected =
      Eigen::Vector3d(0.02, 0.01, 0.0) - of_dvl * information.bottomLeftCorner<3, 4>() * moved;
  EXPECT_LT((estimate.parameters[0].change - Eigen::Vector3d(0.012, 0.001, -0.01)).norm(), 1e-9);
  EXPECT_NEAR(estimate.parameters[1].change(0), 0.005, 1e-12);
  EXPECT_LT((estimate.parameters[2].change - expected).norm(), 1e-9);
  EXPECT_LT((estimate.covariance.bottomRightCorner<3, 3>() - of_dvl).norm(), 1e-12);
  EXPECT_NEAR(estimate.parameters[2].sigma(1), std::sqrt(of_dvl(1, 1)), 1e-9);
  EXPECT_EQ(estimate.covariance.topRows<kDvl>().norm(), 0.0);
}

TEST(AdoptCamera, ChangesNothingIfTheCameraIsThatOfTheWindow) {
  vio::CalibrationEstimate estimate = window_estimate();
  loop_closure::BundleCamera camera = adjusted({0.01, 0.0, -0.01}, 0.004);
  camera.covariance.topLeftCorner<3, 3>() = estimate.covariance.topLeftCorner<3, 3>();
  camera.covariance(6, 6) = estimate.covariance(3, 3);
  adopt_camera(camera, one_camera(), estimate);
  EXPECT_LT((estimate.covariance - window_estimate().covariance).norm(), 1e-12);
  EXPECT_LT((estimate.parameters[2].change - Eigen::Vector3d(0.02, 0.01, 0.0)).norm(), 1e-9);
}

TEST(AdoptCamera, LeavesAnEstimateWithoutACameraAsItIs) {
  vio::CalibrationEstimate estimate;
  estimate.parameters = {{"dvl0.scale", Eigen::VectorXd::Constant(1, 0.02),
                          Eigen::VectorXd::Constant(1, 0.001), 0.01}};
  estimate.covariance = Eigen::MatrixXd::Constant(1, 1, 1e-6);
  adopt_camera(adjusted({0.01, 0.0, 0.0}, 0.0), one_camera(), estimate);
  EXPECT_EQ(estimate.parameters[0].change(0), 0.02);
  EXPECT_EQ(estimate.covariance(0, 0), 1e-6);
}

}  // namespace
}  // namespace apvi::runs
