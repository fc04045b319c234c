// SPDX-License-Identifier: BSD-3-Clause
#include "imu/preintegration.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <span>

#include "support/numeric_jacobian.hpp"
#include "support/spline_imu.hpp"

namespace apvi::imu {
namespace {

using Eigen::Vector3d;
const Vector3d kGravity(0.0, 0.0, -9.80665);

Preintegration preintegrate(std::span<const ImuSample> samples, const Vector3d& gyro_bias,
                            const Vector3d& accel_bias, const Noise& noise = {}) {
  Preintegration sum(noise, gyro_bias, accel_bias);
  for (std::size_t i = 1; i < samples.size(); ++i) sum.integrate(samples[i - 1], samples[i]);
  return sum;
}

Eigen::Matrix<double, 9, 1> difference(const Preintegration::Delta& a,
                                       const Preintegration::Delta& b) {
  Eigen::Matrix<double, 9, 1> d;
  d << so3::log(b.rotation.conjugate() * a.rotation), a.velocity - b.velocity,
      a.position - b.position;
  return d;
}

TEST(Preintegration, MatchesSplineMotion) {
  const Se3Spline spline = test::wavy_spline(11, 4.0);
  const auto samples = test::imu_along(spline, kGravity, 400.0);
  const Preintegration sum = preintegrate(samples, Vector3d::Zero(), Vector3d::Zero());
  const Motion i = spline.at(samples.front().stamp);
  const Motion j = spline.at(samples.back().stamp);
  const double T = sum.duration_s();
  const Eigen::Quaterniond Rt = i.T_world_body.rotation.conjugate();
  const Preintegration::Delta expected{
      Rt * j.T_world_body.rotation, Rt * (j.velocity_world - i.velocity_world - kGravity * T),
      Rt * (j.T_world_body.translation - i.T_world_body.translation - i.velocity_world * T -
            0.5 * kGravity * T * T)};
  EXPECT_NEAR(T, seconds_between(samples.front().stamp, samples.back().stamp), 1e-9);
  const auto error = difference(sum.delta(), expected);
  EXPECT_LT(error.segment<3>(0).norm(), 1e-5);
  EXPECT_LT(error.segment<3>(3).norm(), 1e-4);
  EXPECT_LT(error.segment<3>(6).norm(), 2e-4);
}

TEST(Preintegration, BiasJacobianMatchesNumericalDerivative) {
  const auto samples = test::imu_along(test::wavy_spline(12, 2.0), kGravity, 200.0);
  const Vector3d bg(0.01, -0.02, 0.03);
  const Vector3d ba(0.1, 0.2, -0.1);
  const Preintegration sum = preintegrate(samples, bg, ba);
  const auto f = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
    return difference(preintegrate(samples, bg + d.head<3>(), ba + d.tail<3>()).delta(),
                      sum.delta());
  };
  EXPECT_LT((sum.bias_jacobian() - test::numeric_jacobian(f, 6)).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Preintegration, FirstOrderCorrectionMatchesReintegration) {
  const auto samples = test::imu_along(test::wavy_spline(13, 2.0), kGravity, 200.0);
  const Vector3d bg(0.002, -0.001, 0.0015);
  const Vector3d ba(0.02, 0.01, -0.03);
  const Preintegration at_zero = preintegrate(samples, Vector3d::Zero(), Vector3d::Zero());
  const auto corrected = at_zero.corrected(bg, ba);
  const auto again = preintegrate(samples, bg, ba).delta();
  const double change = difference(again, at_zero.delta()).norm();
  EXPECT_LT(difference(corrected, again).norm(), 0.01 * change);
}

TEST(Preintegration, CovarianceMatchesMonteCarlo) {
  const Noise noise{.gyro = 2e-3, .accel = 3e-2, .gyro_walk = 0.0, .accel_walk = 0.0};
  const auto samples = test::imu_along(test::wavy_spline(14, 1.0), kGravity, 100.0);
  const Preintegration clean = preintegrate(samples, Vector3d::Zero(), Vector3d::Zero(), noise);
  const int runs = 4000;
  Random random(5);
  Eigen::Matrix<double, 9, 9> sampled = Eigen::Matrix<double, 9, 9>::Zero();
  for (int run = 0; run < runs; ++run) {
    Preintegration noisy(noise, Vector3d::Zero(), Vector3d::Zero());
    for (std::size_t i = 1; i < samples.size(); ++i) {
      const double sigma = 1.0 / std::sqrt(seconds_between(samples[i - 1].stamp, samples[i].stamp));
      ImuSample from = samples[i - 1];
      ImuSample to = samples[i];
      const Vector3d gyro_noise = test::normal_vector(random, noise.gyro * sigma);
      const Vector3d accel_noise = test::normal_vector(random, noise.accel * sigma);
      from.gyro += gyro_noise;
      to.gyro += gyro_noise;
      from.accel += accel_noise;
      to.accel += accel_noise;
      noisy.integrate(from, to);
    }
    const auto e = difference(noisy.delta(), clean.delta());
    sampled += e * e.transpose() / runs;
  }
  for (int k = 0; k < 9; ++k) {
    EXPECT_NEAR(sampled(k, k) / clean.covariance()(k, k), 1.0, 0.1) << "component " << k;
  }
}

ImuSample at_rest(double seconds) {
  return {{Duration::from_seconds(seconds).ns}, Vector3d::Zero(), {0.0, 0.0, 9.81}};
}

// White noise a(t) of density q: var(v) = q² T, var(p) = q² T³/3, cov(p, v) = q² T²/2.
TEST(Preintegration, CovarianceOfOneStepIsThatOfContinuousNoise) {
  const Noise noise{.gyro = 1e-9, .accel = 0.02};
  Preintegration sum(noise, Vector3d::Zero(), Vector3d::Zero());
  sum.integrate(at_rest(0.0), at_rest(0.05));
  const double q = 0.02 * 0.02;
  const auto& covariance = sum.covariance();
  EXPECT_NEAR(covariance(3, 3), q * 0.05, 1e-9 * q);
  EXPECT_NEAR(covariance(6, 6), q * std::pow(0.05, 3) / 3.0, 1e-9 * q);
  EXPECT_NEAR(covariance(3, 6), q * std::pow(0.05, 2) / 2.0, 1e-9 * q);
}

TEST(Preintegration, IsUncertainByTheUnknownMotionAfterAGap) {
  const Noise noise{.gyro = 1e-4, .accel = 1e-3};
  Preintegration sum(noise, Vector3d::Zero(), Vector3d::Zero());
  for (int k = 0; k < 10; ++k) sum.integrate(at_rest(0.05 * k), at_rest(0.05 * (k + 1)), 0.5);
  EXPECT_NEAR(std::sqrt(sum.covariance()(0, 0)), kGapTurnRate * 0.5, 1e-4);
  EXPECT_NEAR(std::sqrt(sum.covariance()(5, 5)), kGapAcceleration * 0.5, 1e-4);
}

TEST(Preintegration, RejectsNonIncreasingStamps) {
  Preintegration sum(Noise{}, Vector3d::Zero(), Vector3d::Zero());
  EXPECT_THROW(sum.integrate({.stamp = {10}}, {.stamp = {10}}), std::logic_error);
}

}  // namespace
}  // namespace apvi::imu
