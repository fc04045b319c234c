// SPDX-License-Identifier: BSD-3-Clause
#include "imu/propagation.hpp"

#include <gtest/gtest.h>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"
#include "support/numeric_jacobian.hpp"
#include "support/spline_imu.hpp"

namespace apvi::imu {
namespace {

using Eigen::Vector3d;
using test::random_vector;

EarthModel fast_rotating_earth() {
  // A hundred times the Earth rate, so that a sign error exceeds the tolerance.
  return {.gravity = {0.1, -0.2, -9.8}, .earth_rate = {3e-3, -4e-3, 5e-3}};
}

NavState random_state(Random& random) {
  NavState x;
  x.R_world_body = so3::exp(random_vector(random, 1.5));
  x.p_world = random_vector(random, 10.0);
  x.v_body = random_vector(random, 2.0);
  x.gyro_bias = random_vector(random, 0.1);
  x.accel_bias = random_vector(random, 0.3);
  return x;
}

TEST(NavState, BoxminusInvertsBoxplus) {
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const NavState x = random_state(random);
    NavVector d;
    for (int k = 0; k < kNavSize; ++k) d(k) = random.uniform(-1.0, 1.0);
    EXPECT_LT((boxminus(boxplus(x, d), x) - d).norm(), 1e-12);
  }
}

TEST(Propagation, JacobianMatchesNumericalDerivative) {
  Random random(2);
  const EarthModel world = fast_rotating_earth();
  for (int i = 0; i < 20; ++i) {
    const NavState x = random_state(random);
    const Vector3d gyro = random_vector(random, 1.0);
    const Vector3d accel = random_vector(random, 10.0);
    const double dt = random.uniform(0.002, 0.1);
    NavMatrix F;
    const NavState next = propagate(x, gyro, accel, dt, world, F);
    const auto f = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
      return boxminus(propagate(boxplus(x, d), gyro, accel, dt, world), next);
    };
    const Eigen::MatrixXd numeric = test::numeric_jacobian(f, kNavSize);
    EXPECT_LT((F - numeric).cwiseAbs().maxCoeff(), 1e-7) << "case " << i;
  }
}

TEST(Propagation, BodyAtRestOnRotatingEarthStaysAtRest) {
  const EarthModel world = fast_rotating_earth();
  NavState x;
  x.R_world_body = so3::exp(Vector3d(0.3, -0.4, 0.9));
  const NavState start = x;
  for (int i = 0; i < 1000; ++i) {
    const Vector3d gyro = x.R_world_body.conjugate() * world.earth_rate;
    const Vector3d force = x.R_world_body.conjugate() * Vector3d(-world.gravity);
    x = propagate(x, gyro, force, 0.01, world);
  }
  EXPECT_LT(boxminus(x, start).norm(), 1e-9);
}

TEST(Propagation, FollowsSplineForTenSeconds) {
  const Se3Spline spline = test::wavy_spline(7, 12.0);
  const EarthModel world;
  const auto samples = test::imu_along(spline, world.gravity, 200.0);
  NavState x = test::nav_state_at(spline, samples.front().stamp);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    x = propagate(x, 0.5 * (samples[i - 1].gyro + samples[i].gyro),
                  0.5 * (samples[i - 1].accel + samples[i].accel),
                  seconds_between(samples[i - 1].stamp, samples[i].stamp), world);
  }
  const NavVector error = boxminus(x, test::nav_state_at(spline, samples.back().stamp));
  EXPECT_LT(error.segment<3>(kTheta).norm(), 1e-4);
  EXPECT_LT(error.segment<3>(kVelocity).norm(), 2e-3);
  EXPECT_LT(error.segment<3>(kPosition).norm(), 1e-2);
}

TEST(Propagation, ProcessNoiseMatchesMonteCarlo) {
  const EarthModel world;
  const Noise noise{.gyro = 2e-3, .accel = 3e-2, .gyro_walk = 1e-4, .accel_walk = 1e-3};
  const double dt = 0.01;
  const int steps = 100;
  const int runs = 4000;
  NavState start;
  start.v_body = Vector3d(1.0, 0.2, 0.0);
  const Vector3d gyro(0.1, -0.2, 0.3);
  const Vector3d accel(0.2, 0.1, 9.9);
  NavState mean = start;
  NavMatrix P = NavMatrix::Zero();
  for (int k = 0; k < steps; ++k) {
    NavMatrix F;
    mean = propagate(mean, gyro, accel, dt, world, F);
    P = F * P * F.transpose() + process_noise(F, noise, dt);
  }
  Random random(3);
  NavMatrix sampled = NavMatrix::Zero();
  for (int run = 0; run < runs; ++run) {
    NavState x = start;
    for (int k = 0; k < steps; ++k) {
      x = propagate(x, gyro + test::normal_vector(random, noise.gyro / std::sqrt(dt)),
                    accel + test::normal_vector(random, noise.accel / std::sqrt(dt)), dt, world);
      x.gyro_bias += test::normal_vector(random, noise.gyro_walk * std::sqrt(dt));
      x.accel_bias += test::normal_vector(random, noise.accel_walk * std::sqrt(dt));
    }
    const NavVector e = boxminus(x, mean);
    sampled += e * e.transpose() / runs;
  }
  // A sample variance over 4000 runs has a standard error of 2.2 %.
  for (int k = 0; k < kNavSize; ++k)
    EXPECT_NEAR(sampled(k, k) / P(k, k), 1.0, 0.1) << "state " << k;
}

}  // namespace
}  // namespace apvi::imu
