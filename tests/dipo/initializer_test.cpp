// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/initializer.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <stdexcept>

#include "support/spline_imu.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Vector3d;

constexpr double kGyroBiasSigma = 0.1;  // turn-on bias of a MEMS gyro

Rig make_test_rig() {
  Rig rig;
  rig.imu = ImuCalibration{};
  rig.dvl.emplace().beams = default_dvl_beams();
  return rig;
}

Config make_config() {
  Config config;
  config.initialization.gyro_bias_sigma = kGyroBiasSigma;
  return config;
}

struct Start {
  Initializer::Start found;
  imu::NavState truth;  // at the same time
};

// In motion and turning, with a DVL at five pings a second and an IMU with constant biases.
Start start_under_way(std::uint64_t seed, const Vector3d& gyro_bias, const Vector3d& accel_bias) {
  const Se3Spline spline = test::wavy_spline(seed, 4.0);
  Initializer initializer(make_config(), make_test_rig());
  int k = 0;
  for (const ImuSample& clean : test::imu_along(spline, Vector3d(0.0, 0.0, -9.80665), 100.0)) {
    initializer.add({clean.stamp, clean.gyro + gyro_bias, clean.accel + accel_bias});
    if (k++ % 20 != 0) continue;
    DvlSample ping;
    ping.stamp = clean.stamp;
    ping.valid = true;
    ping.velocity = test::nav_state_at(spline, clean.stamp).v_body;
    initializer.add(ping);
  }
  const auto found = initializer.try_start();
  if (!found) throw std::logic_error("no start");
  return {*found, test::nav_state_at(spline, found->sample.stamp)};
}

// Rotation about the body axes from the estimated to the true vertical.
Vector3d tilt_error(const Start& start) {
  const Vector3d estimated = start.found.state.nav.R_world_body.conjugate() * Vector3d::UnitZ();
  const Vector3d truly = start.truth.R_world_body.conjugate() * Vector3d::UnitZ();
  return truly.cross(estimated);
}

// NEES of the tilt (two components) and the gyro bias (three).
double nees(const Start& start, const Vector3d& gyro_bias) {
  const Vector3d up = start.found.state.nav.R_world_body.conjugate() * Vector3d::UnitZ();
  Eigen::Matrix<double, 5, kSize> pick = Eigen::Matrix<double, 5, kSize>::Zero();
  pick.block<1, 3>(0, 0) = up.unitOrthogonal().transpose();
  pick.block<1, 3>(1, 0) = up.cross(up.unitOrthogonal()).transpose();
  pick.block<3, 3>(2, imu::kGyroBias).setIdentity();
  Vector error = Vector::Zero();
  error.head<3>() = tilt_error(start);
  error.segment<3>(imu::kGyroBias) = gyro_bias;
  const Eigen::MatrixXd P = pick * start.found.covariance * pick.transpose();
  const Eigen::VectorXd e = pick * error;
  return e.dot(P.ldlt().solve(e));
}

TEST(Initializer, EstimatesTheVerticalInMotionWithoutBiases) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Start start = start_under_way(seed, Vector3d::Zero(), Vector3d::Zero());
    EXPECT_LT(tilt_error(start).norm(), 2e-4) << "seed " << seed;
    EXPECT_LT((start.found.state.nav.v_body - start.truth.v_body).norm(), 1e-9);
  }
}

TEST(Initializer, TiltCovarianceIncludesTheGyroBias) {
  constexpr int kStarts = 200;
  Random random(17);
  double sum = 0.0;
  double largest_tilt = 0.0;
  for (int k = 0; k < kStarts; ++k) {
    const Vector3d gyro_bias = test::normal_vector(random, kGyroBiasSigma);
    const Vector3d accel_bias =
        test::normal_vector(random, make_config().initialization.accel_bias_sigma);
    const Start start = start_under_way(static_cast<std::uint64_t>(k), gyro_bias, accel_bias);
    sum += nees(start, gyro_bias);
    largest_tilt = std::max(largest_tilt, tilt_error(start).norm());
  }
  EXPECT_GT(largest_tilt, 0.1);  // more than three times tilt_sigma_deg
  EXPECT_LT(sum / kStarts, 5.0 + 3.3 * std::sqrt(2.0 * 5.0 / kStarts));
  EXPECT_GT(sum / kStarts, 2.5);
}

}  // namespace
}  // namespace apvi::dipo
