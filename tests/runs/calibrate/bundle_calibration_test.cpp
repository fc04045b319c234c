// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/bundle_calibration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>

#include "apvi/geometry/so3.hpp"

namespace apvi::runs {
namespace {

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

TEST(AdoptCamera, ReplacesTheCameraOfTheWindowAndNothingElse) {
  vio::CalibrationEstimate estimate = window_estimate();
  const Eigen::MatrixXd of_dvl = estimate.covariance.bottomRightCorner(3, 3);
  loop_closure::BundleCamera camera = adjusted({0.012, 0.001, -0.01}, 0.005);
  camera.covariance.diagonal().setConstant(4e-8);
  camera.covariance(0, 6) = camera.covariance(6, 0) = 1e-8;
  adopt_camera(camera, one_camera(), estimate);
  EXPECT_LT((estimate.parameters[0].change - Eigen::Vector3d(0.012, 0.001, -0.01)).norm(), 1e-9);
  EXPECT_NEAR(estimate.parameters[0].sigma(1), 2e-4, 1e-12);
  EXPECT_NEAR(estimate.parameters[1].change(0), 0.005, 1e-12);
  EXPECT_EQ(estimate.covariance(0, 3), 1e-8);
  EXPECT_EQ(estimate.parameters[2].change, window_estimate().parameters[2].change);
  EXPECT_EQ(estimate.covariance.bottomRightCorner(3, 3), of_dvl);
  EXPECT_TRUE(estimate.covariance.topRightCorner(4, 3).isZero(0.0));
  EXPECT_TRUE(estimate.covariance.bottomLeftCorner(3, 4).isZero(0.0));
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
