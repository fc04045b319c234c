// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/measurements.hpp"

#include <gtest/gtest.h>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"
#include "support/numeric_jacobian.hpp"
#include "support/spline_imu.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using test::random_vector;

State some_state(Random& random) {
  State x;
  x.nav.R_world_body = so3::exp(random_vector(random, 1.5));
  x.nav.p_world = random_vector(random, 10.0);
  x.nav.v_body = random_vector(random, 2.0);
  x.nav.gyro_bias = random_vector(random, 0.1);
  x.nav.accel_bias = random_vector(random, 0.3);
  x.dvl_time_offset_s = random.uniform(0.0, 0.3);
  x.dvl_scale_error = random.uniform(-0.05, 0.05);
  x.R_body_dvl = so3::exp(random_vector(random, 1.0));
  x.p_body_dvl = random_vector(random, 1.0);
  x.depth_bias_m = random.uniform(-0.3, 0.3);
  x.p_last_ping = random_vector(random, 10.0);
  return x;
}

Kinematics some_kinematics(Random& random) {
  return {random_vector(random, 0.5), random_vector(random, 10.0), random_vector(random, 0.2)};
}

// Compares H with the negative numeric derivative of the residual of `make(state)`.
template <typename Make>
void expect_jacobian(const State& x, Make&& make) {
  const Measurement m = make(x);
  const auto f = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
    return -make(boxplus(x, Vector(d))).residual;
  };
  const Eigen::MatrixXd numeric = test::numeric_jacobian(f, static_cast<Eigen::Index>(kSize));
  Measurement::Jacobian H = m.H;
  // The state is that at stamp - offset, so the offset column is not part of this residual; it has
  // a test of its own.
  H.col(kTimeOffset).setZero();
  EXPECT_LT((H - numeric).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(Measurements, JacobiansMatchNumericDifferences) {
  Random random(21);
  const imu::EarthModel world{.gravity = {0.0, 0.0, -9.8}, .earth_rate = {3e-3, -4e-3, 5e-3}};
  for (int i = 0; i < 20; ++i) {
    const State x = some_state(random);
    const Kinematics k = some_kinematics(random);
    const Vector3d z = random_vector(random, 2.0);
    const Vector3d beam = random_vector(random, 1.0).normalized();
    const Matrix3d R = Matrix3d::Identity();
    expect_jacobian(x, [&](const State& s) { return dvl_velocity(s, k, world, z, R); });
    expect_jacobian(x, [&](const State& s) { return dvl_beam(s, k, world, beam, z.x(), 1.0); });
    expect_jacobian(x, [&](const State& s) { return dvl_displacement(s, z, R); });
    expect_jacobian(x, [&](const State& s) { return pressure_depth(s, z, -1.0, 3.0, 1.0); });
    expect_jacobian(x, [&](const State& s) { return zero_velocity(s, 1.0); });
  }
}

TEST(Measurements, TimeOffsetJacobianMatchesNumericDifference) {
  const imu::EarthModel world;
  const Se3Spline spline = test::wavy_spline(22, 10.0);
  const Stamp stamp = spline.start() + Duration::from_seconds(5.0);
  State x;
  x.R_body_dvl = so3::exp(Vector3d(0.2, -0.3, 0.8));
  x.p_body_dvl = Vector3d(-1.8, 0.1, 0.2);
  const auto predict_at = [&](double offset_s) -> Vector3d {
    State at = x;
    const Stamp t = stamp - Duration::from_seconds(offset_s);
    at.nav = test::nav_state_at(spline, t);
    return predict_dvl(at, test::imu_at(spline, world.gravity, t).gyro);
  };
  const double h = 1e-4;
  const Vector3d numeric = (predict_at(h) - predict_at(-h)) / (2.0 * h);
  x.nav = test::nav_state_at(spline, stamp);
  const ImuSample sample = test::imu_at(spline, world.gravity, stamp);
  const Kinematics k{sample.gyro, sample.accel, spline.at(stamp).angular_acceleration_body};
  const Measurement m = dvl_velocity(x, k, world, Vector3d::Zero(), Matrix3d::Identity());
  EXPECT_LT((m.H.col(kTimeOffset) - numeric).norm(), 1e-5);
  EXPECT_GT(numeric.norm(), 0.01) << "the test requires an accelerating vehicle";
}

TEST(Measurements, PredictDvlAppliesScaleMountingAndLeverArm) {
  State x;
  x.nav.v_body = Vector3d(1.0, 0.0, 0.0);
  x.dvl_scale_error = 0.1;
  x.R_body_dvl = Eigen::AngleAxisd(std::acos(-1.0) / 2, Vector3d::UnitZ());  // x_dvl is y_body
  x.p_body_dvl = Vector3d(2.0, 0.0, 0.0);
  const Vector3d yaw_rate(0.0, 0.0, 0.5);  // lateral velocity of 1 m/s at the DVL
  EXPECT_LT((predict_dvl(x, yaw_rate) - 1.1 * Vector3d(1.0, -1.0, 0.0)).norm(), 1e-12);
}

}  // namespace
}  // namespace apvi::dipo
