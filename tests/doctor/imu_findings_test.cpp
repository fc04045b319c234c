// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doctor/dive.hpp"

namespace apvi::doctor {
namespace {

using test::Dive;
using test::examine;
using test::healthy_dive;

TEST(HealthyDive, HasOnlyOkFindings) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  test::add_pressure(dive);
  const Report report = examine(dive);
  EXPECT_EQ(report.count(Severity::error), 0u) << to_text(report);
  EXPECT_EQ(report.count(Severity::warning), 0u) << to_text(report);
  EXPECT_EQ(report.count(Severity::note), 0u) << to_text(report);
  for (const char* check : {"rate", "gaps", "gravity", "up", "gyro unit", "gyro, gravity"}) {
    EXPECT_NE(report.find("imu0", check), nullptr) << check;
  }
}

TEST(ImuFindings, AccelerationsInGAreAnError) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.accel /= 9.80665;
  EXPECT_FINDING(examine(dive), "imu0", "gravity", error, "these are g");
}

TEST(ImuFindings, AccelerationsInMilliGAreAnError) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.accel *= 1000.0 / 9.80665;
  EXPECT_FINDING(examine(dive), "imu0", "gravity", error, "milli-g");
}

TEST(ImuFindings, AccelerationsWithoutGravityAreAnError) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) {
    s.accel -= dive.spline.at(s.stamp).T_world_body.rotation.conjugate() *
               Eigen::Vector3d(0.0, 0.0, 9.80665);
  }
  EXPECT_FINDING(examine(dive), "imu0", "gravity", error, "removed");
}

TEST(ImuFindings, WrongAccelerometerScaleIsAWarning) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.accel *= 1.06;
  EXPECT_FINDING(examine(dive), "imu0", "gravity", warning, "calibration");
}

TEST(ImuFindings, ImuUpsideDownIsAWarning) {
  Dive dive = healthy_dive();
  const Eigen::DiagonalMatrix<double, 3> turned(1.0, -1.0, -1.0);
  for (ImuSample& s : dive.imu) {
    s.accel = turned * s.accel;
    s.gyro = turned * s.gyro;
  }
  EXPECT_FINDING(examine(dive), "imu0", "up", warning, "upside down");
}

TEST(ImuFindings, ImuOnItsSideIsANote) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) {
    s.accel = Eigen::Vector3d(s.accel.z(), s.accel.y(), -s.accel.x());
    s.gyro = Eigen::Vector3d(s.gyro.z(), s.gyro.y(), -s.gyro.x());
  }
  EXPECT_FINDING(examine(dive), "imu0", "up", note, "not vertical");
}

TEST(ImuFindings, GyroInDegreesIsAnError) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.gyro *= 57.29578;
  const Report report = examine(dive);
  EXPECT_FINDING(report, "imu0", "gyro unit", error, "0.0174533");
  EXPECT_FINDING(report, "imu0", "gyro, gravity", error, "deg/s");
  EXPECT_FINDING(report, "dvl0", "time, imu", note, "not checked");
}

TEST(ImuFindings, ReversedGyroIsAnError) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.gyro = -s.gyro;
  EXPECT_FINDING(examine(dive), "imu0", "gyro, gravity", error, "sense of rotation");
}

TEST(ImuFindings, NoisyGyroAtRestIsOk) {
  Dive dive = healthy_dive();
  Random random(9);
  for (ImuSample& s : dive.imu) {
    s.gyro = test::normal_vector(random, 0.1);
    s.accel = Eigen::Vector3d(0.0, 0.0, 9.80665) + test::normal_vector(random, 0.05);
  }
  EXPECT_FINDING(examine(dive), "imu0", "gyro, gravity", ok, "rotated by the gyro");
}

TEST(ImuFindings, WrongRateIsAWarning) {
  Dive dive = healthy_dive();
  dive.rig.replace(dive.rig.find("rate_hz: 100"), 12, "rate_hz: 200");
  const Report report = examine(dive);
  EXPECT_FINDING(report, "imu0", "rate", warning, "nominal 200 Hz");
  EXPECT_NEAR(test::value_of(report, "imu0", "rate", "median_hz"), 100.0, 0.01);
}

TEST(ImuFindings, GapIsAWarningWithTimeAndLength) {
  Dive dive = healthy_dive();
  dive.imu.erase(dive.imu.begin() + 2000, dive.imu.begin() + 2100);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "imu0", "gaps", warning, "at 20.0 s");
  EXPECT_NEAR(test::value_of(report, "imu0", "gaps", "longest_s"), 1.01, 1e-6);
}

TEST(ImuFindings, ArrivalTimeStampsAreANote) {
  Dive dive = healthy_dive();
  Random random(3);
  for (ImuSample& s : dive.imu)
    s.stamp = s.stamp + Duration::from_seconds(random.uniform(0, 0.009));
  EXPECT_FINDING(examine(dive), "imu0", "jitter", note, "arrival times");
}

TEST(ImuFindings, RepeatedSamplesAreAWarning) {
  Dive dive = healthy_dive();
  for (std::size_t i = 1; i < dive.imu.size(); i += 2) {
    dive.imu[i].gyro = dive.imu[i - 1].gyro;
    dive.imu[i].accel = dive.imu[i - 1].accel;
  }
  const Report report = examine(dive);
  EXPECT_FINDING(report, "imu0", "repeats", warning, "repeat the previous one");
  EXPECT_NEAR(test::value_of(report, "imu0", "repeats", "fresh_hz"), 50.0, 0.5);
}

TEST(ImuFindings, FrozenImuIsAnError) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) {
    s.gyro = dive.imu.front().gyro;
    s.accel = dive.imu.front().accel;
  }
  EXPECT_FINDING(examine(dive), "imu0", "repeats", error, "hangs");
}

TEST(ImuFindings, CountsDroppedSamplesByReason) {
  Dive dive = healthy_dive();
  std::swap(dive.imu[500], dive.imu[501]);
  dive.imu[700].stamp = dive.imu[699].stamp;
  dive.imu[900].gyro.x() = std::nan("");
  const Report report = examine(dive);
  EXPECT_FINDING(report, "imu0", "reading", warning, "1 of 12");
  EXPECT_FINDING(report, "imu0", "duplicate stamp", warning, "1 of 12");
  EXPECT_FINDING(report, "imu0", "not finite", warning, "data.csv:902");
}

}  // namespace
}  // namespace apvi::doctor
