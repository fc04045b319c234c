// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/segment.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <map>
#include <vector>

#include "apvi/core/constants.hpp"
#include "dipo/dipo.hpp"
#include "support/spline_imu.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Vector3d;

constexpr double kDive_s = 40.0;
constexpr double kPauseAt_s = 20.0;
constexpr double kDepthOffset_m = 10.0;  // of the world of the motion below the surface
const Vector3d kGravity(0.0, 0.0, -kStandardGravity);

Rig make_test_rig() {
  Rig rig;
  rig.imu = ImuCalibration{.rate_hz = 100.0,
                           .gyro_noise_density = 2e-4,
                           .gyro_random_walk = 1e-6,
                           .accel_noise_density = 2e-3,
                           .accel_random_walk = 1e-5};
  rig.dvl = DvlCalibration{};
  rig.dvl->velocity_noise = 0.005;
  rig.depth = PressureDepthCalibration{.p_body_sensor = Vector3d::Zero(), .noise_m = 0.01};
  return rig;
}

struct Estimates {
  std::vector<Estimate> before;
  std::vector<Estimate> after;
  std::vector<SE3> true_before, true_after;
  std::map<Verdict, int> pings_after;
  double uninitialized_s = 0.0;  // after the pause
};

using Vehicle = std::function<Motion(double)>;

// A dive recorded with IMU, DVL and depth sensor; `motion` of the vehicle by recorded time. The
// recording pauses in the middle.
Estimates record(const Vehicle& motion_at, double pause_s, const Config& config = {},
                 bool with_depth = true) {
  Random random(6);
  Dipo dipo(config, make_test_rig());
  Estimates result;
  for (int k = 0; k < static_cast<int>(100.0 * kDive_s); ++k) {
    const double t = 0.01 * k;
    const bool later = t > kPauseAt_s;
    const Motion motion = motion_at(t);
    const SE3& T = motion.T_world_body;
    const Eigen::Quaterniond R_body_world = T.rotation.conjugate();
    const Stamp stamp = Stamp{1'000'000'000} + Duration::from_seconds(t + (later ? pause_s : 0.0));
    dipo.add(ImuSample{
        stamp, motion.angular_velocity_body + test::normal_vector(random, 2e-3),
        R_body_world * (motion.acceleration_world - kGravity) + test::normal_vector(random, 2e-2)});
    if (k % 20 == 5) {
      DvlSample ping;
      ping.stamp = stamp;
      ping.valid = true;
      ping.velocity = R_body_world * motion.velocity_world + test::normal_vector(random, 0.005);
      dipo.add(ping);
    }
    if (k % 10 == 3 && with_depth)
      dipo.add(PressureDepthSample{stamp, kDepthOffset_m - T.translation.z()});
    for (const Report& report : dipo.take_dvl_reports()) {
      if (later) ++result.pings_after[report.verdict];
    }
    const auto estimate = dipo.latest();
    if (later && !estimate) result.uninitialized_s += 0.01;
    if (!estimate) continue;
    (later ? result.after : result.before).push_back(*estimate);
    (later ? result.true_after : result.true_before).push_back(T);
  }
  return result;
}

Vehicle wavy_vehicle() {
  const Se3Spline spline = test::wavy_spline(5, kDive_s);
  return [spline](double t) { return spline.at(spline.start() + Duration::from_seconds(t)); };
}

// Level and straight ahead at constant speed. During the pause the vehicle is carried away.
Vehicle straight_vehicle(double speed, const SE3& carried) {
  return [=](double t) {
    Motion motion;
    motion.T_world_body = {Eigen::Quaterniond::Identity(), {speed * t, 0.0, 0.0}};
    if (t > kPauseAt_s) {
      motion.T_world_body.translation.x() -= speed * kPauseAt_s;
      motion.T_world_body = carried * motion.T_world_body;
    }
    motion.velocity_world = motion.T_world_body.rotation * Vector3d(speed, 0.0, 0.0);
    return motion;
  };
}

// Largest error of the path within one segment, in the frame of its first pose.
double shape_error_m(const std::vector<Estimate>& estimates, const std::vector<SE3>& truth) {
  double worst = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const SE3 moved = estimates[0].state.nav.pose().inverse() * estimates[i].state.nav.pose();
    const SE3 true_moved = truth[0].inverse() * truth[i];
    worst = std::max(worst, (moved.translation - true_moved.translation).norm());
  }
  return worst;
}

SegmentError::Matrix6 pose_covariance(const Estimate& estimate) {
  return estimate.covariance.topLeftCorner<6, 6>() + estimate.segment_covariance;
}

double sigma_of_x(const Estimate& estimate) {
  return std::sqrt(pose_covariance(estimate)(3, 3));
}

double sigma_of_heading(const Estimate& estimate) {
  const Vector3d up = estimate.state.nav.R_world_body.conjugate() * Vector3d::UnitZ();
  return std::sqrt(up.dot(pose_covariance(estimate).topLeftCorner<3, 3>() * up));
}

TEST(Segment, ShapeIsThatOfTheVehicleBeforeAndAfterAPauseOfAnyLength) {
  const Estimates whole = record(wavy_vehicle(), 0.0);
  ASSERT_EQ(whole.uninitialized_s, 0.0);
  for (const double pause_s : {5.0, 30.0, 3600.0, 86400.0, 1.4e9}) {
    const Estimates dive = record(wavy_vehicle(), pause_s);
    ASSERT_FALSE(dive.after.empty()) << pause_s;
    EXPECT_GT(dive.uninitialized_s, 0.3) << pause_s;
    EXPECT_LT(dive.uninitialized_s, 1.5) << pause_s;
    EXPECT_LT(shape_error_m(dive.before, dive.true_before), 0.2) << pause_s;
    EXPECT_LT(shape_error_m(dive.after, dive.true_after), 0.2) << pause_s;
    EXPECT_NEAR(dive.after.back().state.nav.p_world.z(),
                dive.true_after.back().translation.z() - kDepthOffset_m, 0.1)
        << pause_s;
  }
}

TEST(Segment, AVehicleCarriedAwayGoesStraightOnInANewSegment) {
  const SE3 carried{Eigen::Quaterniond(Eigen::AngleAxisd(2.0, Vector3d::UnitZ())),
                    {30.0, -20.0, -4.0}};
  const Estimates dive = record(straight_vehicle(1.0, carried), 30.0);
  ASSERT_FALSE(dive.after.empty());
  EXPECT_LT(shape_error_m(dive.after, dive.true_after), 0.1);
  EXPECT_NEAR(dive.after.front().state.nav.p_world.z(), carried.translation.z() - kDepthOffset_m,
              0.2);
  const auto used = dive.pings_after.at(Verdict::accepted);
  EXPECT_GE(used, 90);  // of 100
  // The true pose is within the reported uncertainty.
  const SE3 error = dive.after.back().state.nav.pose().inverse() * dive.true_after.back();
  Eigen::Matrix<double, 6, 1> delta;
  delta << so3::log(error.rotation), dive.after.back().state.nav.R_world_body * error.translation;
  const Eigen::Vector3d position = delta.tail<3>() - Vector3d(0.0, 0.0, delta(5));
  EXPECT_LT(position.norm(), 3.0 * std::sqrt(2.0) * sigma_of_x(dive.after.back()));
  EXPECT_LT(std::abs(delta(2)), 3.0 * sigma_of_heading(dive.after.back()));
}

TEST(Segment, PositionAndHeadingContinueWithTheUncertaintyOfThePause) {
  for (const double pause_s : {5.0, 30.0, 3600.0, 86400.0}) {
    const Estimates dive = record(wavy_vehicle(), pause_s);
    const Estimate& before = dive.before.back();
    const Estimate& after = dive.after.front();
    const Vector3d jump = after.state.nav.p_world - before.state.nav.p_world;
    EXPECT_LT(jump.head<2>().norm(), 1.0);  // the vehicle moved during initialization
    EXPECT_NEAR(so3::yaw(after.state.nav.R_world_body), so3::yaw(before.state.nav.R_world_body),
                0.3);
    EXPECT_LT(sigma_of_x(before), 1.0);
    EXPECT_GE(sigma_of_x(after), 2.0 * pause_s) << "2 m/s";
    EXPECT_LT(sigma_of_x(after), 2.0 * (pause_s + 2.0)) << "2 m/s";
    EXPECT_GE(sigma_of_heading(after), std::min(0.2 * pause_s, 1.8)) << pause_s;
    EXPECT_LT(sigma_of_heading(after), 2.0) << pause_s;
  }
}

TEST(Segment, UncertaintyWithinASegmentIsThatOfAFreshStart) {
  const Estimates dive = record(straight_vehicle(1.0, SE3::identity()), 3600.0);
  const std::size_t n = std::min(dive.before.size(), dive.after.size());
  const auto& first = dive.before[n - 1].covariance;
  const auto& second = dive.after[n - 1].covariance;
  EXPECT_TRUE(dive.before[n - 1].segment_covariance.isZero(0.0));
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(std::sqrt(second(i, i)), std::sqrt(first(i, i)), 0.3 * std::sqrt(first(i, i))) << i;
  }
}

TEST(Segment, HeightWithoutADepthSensorContinuesWithTheUncertaintyOfThePause) {
  const Estimates dive = record(wavy_vehicle(), 30.0, {}, false);
  ASSERT_FALSE(dive.after.empty());
  EXPECT_NEAR(dive.after.front().state.nav.p_world.z(), dive.before.back().state.nav.p_world.z(),
              0.5);
  EXPECT_NEAR(std::sqrt(pose_covariance(dive.after.front())(5, 5)), 60.0, 2.0);
}

TEST(Segment, ASecondPauseAddsToTheUncertaintyOfTheFirst) {
  const SE3 pose{Eigen::Quaterniond::Identity(), {1.0, 2.0, 3.0}};
  const SegmentError first(pose, SegmentError::Matrix6::Zero(), 3.0, true);
  const SE3 end{pose.rotation, pose.translation + Vector3d(10.0, 0.0, 0.0)};
  const SegmentError second(end, first.covariance(end), 4.0, true);
  EXPECT_NEAR(second.covariance(end)(2, 2), 0.36 + 0.64, 1e-12);
  EXPECT_NEAR(second.covariance(end)(3, 3), 36.0 + 64.0, 1e-9);
  EXPECT_NEAR(second.covariance(end)(4, 4), 36.0 + 64.0 + 100.0 * 0.36, 1e-9);
}

// The covariance of the shared error against samples of it.
TEST(SegmentError, CovarianceIsThatOfSegmentsTurnedAndMoved) {
  const SE3 origin{so3::exp({0.2, -0.1, 1.0}), {1.0, 2.0, 3.0}};
  const double pause_s = 0.05;  // small, as the covariance is of first order
  const SegmentError error(origin, SegmentError::Matrix6::Zero(), pause_s, true);
  const SE3 pose{so3::exp({-0.3, 0.2, 2.0}), {6.0, -2.0, 4.0}};
  Random random(3);
  SegmentError::Matrix6 sum = SegmentError::Matrix6::Zero();
  constexpr int kSamples = 40000;
  for (int i = 0; i < kSamples; ++i) {
    const Eigen::Quaterniond turn = so3::exp({0.0, 0.0, random.normal(0.0, 0.2 * pause_s)});
    const Vector3d moved = test::normal_vector(random, 2.0 * pause_s);
    const Vector3d p = origin.translation + moved + turn * (pose.translation - origin.translation);
    Eigen::Matrix<double, 6, 1> delta;
    delta << so3::log(pose.rotation.conjugate() * (turn * pose.rotation)), p - pose.translation;
    sum += delta * delta.transpose() / kSamples;
  }
  const SegmentError::Matrix6 expected = error.covariance(pose);
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(sum(i, i), expected(i, i), 0.03 * expected(i, i)) << i;
  EXPECT_NEAR(sum(2, 4), expected(2, 4), 0.05 * std::sqrt(expected(2, 2) * expected(4, 4)));
}

TEST(Segment, BiasesContinue) {
  Config config;
  config.initialization.gyro_bias_sigma = 0.1;
  const Vehicle vehicle = wavy_vehicle();
  const Vector3d bias(0.02, -0.01, 0.03);
  const Vehicle biased = [&](double t) {
    Motion motion = vehicle(t);
    motion.angular_velocity_body += bias;
    return motion;
  };
  const Estimates dive = record(biased, 3600.0, config);
  EXPECT_LT((dive.after.front().state.nav.gyro_bias - bias).norm(), 0.5 * bias.norm());
  EXPECT_LT(shape_error_m(dive.after, dive.true_after), 0.3);
}

bool equal(const std::vector<Estimate>& a, const std::vector<Estimate>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    return x.stamp == y.stamp && x.state.nav.p_world == y.state.nav.p_world &&
           x.state.nav.R_world_body.coeffs() == y.state.nav.R_world_body.coeffs() &&
           x.covariance == y.covariance && x.segment_covariance == y.segment_covariance;
  });
}

TEST(Segment, AGapUpToTheLimitChangesNoBit) {
  Config unlimited;
  unlimited.inertial.segment_gap_s = 1e9;
  for (const double pause_s : {0.0, 0.3, 2.9}) {
    const Estimates dive = record(wavy_vehicle(), pause_s);
    const Estimates bridged = record(wavy_vehicle(), pause_s, unlimited);
    EXPECT_EQ(dive.uninitialized_s, 0.0) << pause_s;
    EXPECT_TRUE(equal(dive.after, bridged.after)) << pause_s;
    EXPECT_TRUE(equal(dive.before, bridged.before)) << pause_s;
  }
  EXPECT_FALSE(
      equal(record(wavy_vehicle(), 3.1).after, record(wavy_vehicle(), 3.1, unlimited).after));
}

}  // namespace
}  // namespace apvi::dipo
