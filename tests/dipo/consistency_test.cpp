// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include "dipo/filter_history.hpp"
#include "support/spline_imu.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kSeeds = 50;
constexpr int kStates = kTimeOffset + 1;  // motion, biases and time offset
constexpr double kDuration_s = 40.0;
constexpr double kImuRate_hz = 100.0;
constexpr double kDvlPeriod_s = 0.2;
constexpr double kDvlNoise = 0.01;
constexpr double kDepthPeriod_s = 0.1;
constexpr double kDepthNoise = 0.02;
const imu::Noise kNoise{.gyro = 1e-3, .accel = 1e-2, .gyro_walk = 2e-5, .accel_walk = 2e-4};
const Vector3d kDepthLever(0.1, -0.2, 0.3);

struct Truth {
  Se3Spline spline;
  std::vector<State> states;  // at every inertial sample
  std::vector<ImuSample> imu;
};

// Inertial data with white noise and random-walk biases, and the true states.
Truth make_truth(std::uint64_t seed, Random& random, const State& start,
                 const imu::EarthModel& world) {
  Truth truth{test::wavy_spline(seed, kDuration_s), {}, {}};
  truth.imu = test::imu_along(truth.spline, world.gravity, kImuRate_hz);
  State state = start;
  const double dt = 1.0 / kImuRate_hz;
  for (ImuSample& sample : truth.imu) {
    const imu::NavState nav = test::nav_state_at(truth.spline, sample.stamp);
    state.nav.R_world_body = nav.R_world_body;
    state.nav.p_world = nav.p_world;
    state.nav.v_body = nav.v_body;
    truth.states.push_back(state);
    sample.gyro += state.nav.gyro_bias + test::normal_vector(random, kNoise.gyro / std::sqrt(dt));
    sample.accel +=
        state.nav.accel_bias + test::normal_vector(random, kNoise.accel / std::sqrt(dt));
    state.nav.gyro_bias += test::normal_vector(random, kNoise.gyro_walk * std::sqrt(dt));
    state.nav.accel_bias += test::normal_vector(random, kNoise.accel_walk * std::sqrt(dt));
  }
  return truth;
}

Matrix initial_covariance() {
  Matrix P = Matrix::Zero();
  const auto set = [&](int index, int count, double sigma) {
    P.diagonal().segment(index, count).setConstant(sigma * sigma);
  };
  set(imu::kTheta, 3, 0.02);
  set(imu::kPosition, 3, 0.05);
  set(imu::kVelocity, 3, 0.05);
  set(imu::kGyroBias, 3, 2e-3);
  set(imu::kAccelBias, 3, 0.02);
  set(kTimeOffset, 1, 0.05);
  return P;
}

// True minus estimated error state, for the estimated states.
Eigen::Matrix<double, kStates, 1> error(const State& truth, const State& estimate) {
  Eigen::Matrix<double, kStates, 1> e;
  e << imu::boxminus(truth.nav, estimate.nav), truth.dvl_time_offset_s - estimate.dvl_time_offset_s;
  return e;
}

FilterHistory::Model dvl_model(const Vector3d& velocity, double offset_s,
                               const imu::EarthModel& world) {
  return [=](const Eskf& filter, const Kinematics& k) {
    const State& x = filter.state();
    Measurement m = dvl_velocity(
        x, k, world, velocity,
        kDvlNoise * kDvlNoise * Matrix3d::Identity() + time_offset_noise(filter, k, world));
    m.residual -= m.H.col(kTimeOffset) * (x.dvl_time_offset_s - offset_s);
    return m;
  };
}

// One run; returns the NEES at its end.
double run_nees(std::uint64_t seed) {
  Random random(seed);
  const imu::EarthModel world;
  const Matrix P = initial_covariance();
  Vector initial_error;
  for (int i = 0; i < static_cast<int>(kSize); ++i) {
    initial_error(i) = random.normal(0.0, std::sqrt(P(i, i)));
  }
  State start;
  start.p_body_dvl = Vector3d(0.3, 0.1, 0.2);
  start.dvl_time_offset_s = 0.3;
  const Truth truth = make_truth(seed, random, start, world);
  // The truth is the initial guess plus an error drawn from the filter's own covariance.
  const State guess = boxplus(truth.states.front(), Vector(-initial_error));
  FilterHistory history(world, {}, Duration::from_seconds(1.0), Duration::from_seconds(1.0));
  history.start(truth.imu.front(), Eskf(guess, P));

  double next_dvl = 0.5;
  double next_depth = 0.25;
  for (std::size_t i = 1; i < truth.imu.size(); ++i) {
    history.push(truth.imu[i], kNoise);
    const Stamp now = truth.imu[i].stamp;
    const double t = seconds_between(truth.spline.start(), now);
    if (t >= next_depth) {
      next_depth += kDepthPeriod_s;
      const Vector3d p =
          truth.states[i].nav.p_world + truth.states[i].nav.R_world_body * kDepthLever;
      const double z = -p.z() + random.normal(0.0, kDepthNoise);
      history.insert(now, [z](const Eskf& filter, const Kinematics&) {
        return pressure_depth(filter.state(), kDepthLever, -1.0, z, kDepthNoise * kDepthNoise);
      });
    }
    if (t >= next_dvl) {  // stamped now, measured 0.3 s ago
      next_dvl += kDvlPeriod_s;
      const Stamp then = now - Duration::from_seconds(start.dvl_time_offset_s);
      State at = truth.states[i];
      at.nav = test::nav_state_at(truth.spline, then);
      const Vector3d gyro = test::imu_at(truth.spline, world.gravity, then).gyro;
      const Vector3d velocity = predict_dvl(at, gyro) + test::normal_vector(random, kDvlNoise);
      const double offset_s = history.newest_filter().state().dvl_time_offset_s;
      const Stamp stamp = now - Duration::from_seconds(offset_s);
      if (history.covers(stamp)) history.insert(stamp, dvl_model(velocity, offset_s, world));
    }
  }
  const Eskf& filter = history.newest_filter();
  const auto e = error(truth.states.back(), filter.state());
  return e.dot(filter.covariance().topLeftCorner<kStates, kStates>().ldlt().solve(e));
}

TEST(Consistency, NeesOverFiftySeedsIsWithin95PercentBounds) {
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) sum += run_nees(seed);
  // The sum of fifty has kSeeds * kStates degrees of freedom; normal approximation of chi square.
  const double dof = kSeeds * kStates;
  const double half_width = 1.96 * std::sqrt(2.0 * dof);
  RecordProperty("mean_nees_per_state", std::to_string(sum / dof));
  EXPECT_GT(sum, dof - half_width) << "mean NEES per state " << sum / dof;
  EXPECT_LT(sum, dof + half_width) << "mean NEES per state " << sum / dof;
}

}  // namespace
}  // namespace apvi::dipo
