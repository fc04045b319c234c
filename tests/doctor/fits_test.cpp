// SPDX-License-Identifier: BSD-3-Clause
// Fits between sensors recover the parameters of a simulated dive.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "apvi/geometry/so3.hpp"
#include "doctor/dive.hpp"
#include "doctor/inertial_path.hpp"
#include "doctor/scan.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Vector3d;
using test::Dive;
using test::examine;
using test::healthy_dive;
using test::value_of;

void make_late(std::vector<DvlSample>& pings, double seconds) {
  for (DvlSample& s : pings) s.stamp = s.stamp + Duration::from_seconds(seconds);
}

// Converts the pings to those of a DVL with another mounting.
void mount(Dive& dive, const Eigen::Matrix3d& body_from_reported) {
  for (DvlSample& s : dive.dvl) {
    s.velocity = body_from_reported.inverse() * s.velocity;
    for (auto& beam : s.beams) beam.reset();
  }
}

// Reference of an inertial navigation system that assumes the DVL's stamps are delayed by
// `assumed_s`: correct attitude, time-shifted velocity.
void set_reference(Dive& dive, double assumed_s) {
  Vector3d p = Vector3d::Zero();
  const Duration step = Duration::from_seconds(0.02);
  int i = 0;
  for (Stamp t = dive.spline.start() + Duration::from_seconds(1.0);
       t <= dive.spline.end() - Duration::from_seconds(1.0); t = t + step, ++i) {
    const Motion now = dive.spline.at(t);
    const Motion then = dive.spline.at(t + Duration::from_seconds(assumed_s));
    const Vector3d dvl = then.T_world_body.rotation.conjugate() * then.velocity_world +
                         then.angular_velocity_body.cross(test::kTrueLever);
    const Vector3d body = dvl - now.angular_velocity_body.cross(test::kTrueLever);
    if (i % 50 == 0) dive.reference.push_back({t, {now.T_world_body.rotation, p}});
    p += step.seconds() * (now.T_world_body.rotation * body);
  }
}

Dive long_dive() {
  Dive dive = healthy_dive();
  dive.spline = test::wavy_spline(21, 300.0);
  dive.imu = test::imu_along(dive.spline, {0.0, 0.0, -9.80665}, 100.0);
  dive.dvl.clear();
  Random random(8);
  for (Stamp t = dive.spline.start(); t <= dive.spline.end(); t = t + Duration::from_seconds(0.2)) {
    dive.dvl.push_back(dive.ping(t, random));
  }
  return dive;
}

TEST(DvlAgainstImu, HasNoFindingsOnConsistentData) {
  const Report report = examine(healthy_dive());
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.0, 0.01);
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "x_m"), test::kTrueLever.x(), 0.03);
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "y_m"), test::kTrueLever.y(), 0.03);
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "z_m"), test::kTrueLever.z(), 0.03);
  EXPECT_LT(value_of(report, "dvl0", "mounting", "turn_deg"), 1.0);
  EXPECT_NEAR(value_of(report, "dvl0", "scale, imu", "low"), 1.0, 0.03);
  EXPECT_NEAR(value_of(report, "dvl0", "scale, imu", "high"), 1.0, 0.03);
}

TEST(DvlAgainstImu, FindsDelayedStamps) {
  Dive dive = healthy_dive();
  make_late(dive.dvl, 0.23);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "time, imu", warning, "late by 0.23 s");
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.23, 0.01);
  EXPECT_LT(value_of(report, "dvl0", "time, imu", "sigma_s"), 0.02);
}

TEST(DvlAgainstImu, FindsEarlyStamps) {
  Dive dive = healthy_dive();
  make_late(dive.dvl, -0.4);
  EXPECT_FINDING(examine(dive), "dvl0", "time, imu", warning, "early by 0.40 s");
}

TEST(DvlAgainstImu, IsOkWhenRigHasTheOffset) {
  Dive dive = healthy_dive();
  make_late(dive.dvl, 0.23);
  dive.rig.insert(dive.rig.rfind('}'), ", time_offset_s: 0.23");
  EXPECT_FINDING(examine(dive), "dvl0", "time, imu", ok, "late by 0.23 s");
}

TEST(DvlAgainstImu, FindsWrongLeverArm) {
  Dive dive = healthy_dive();
  dive.rig.replace(dive.rig.find("1,0,0,0.2"), 9, "1,0,0,-1.8");
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "lever arm", warning, "the rig says (-1.80");
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "x_m"), 0.2, 0.03);
}

TEST(DvlAgainstImu, FindsSmallMountingError) {
  Dive dive = healthy_dive();
  mount(dive, so3::exp(Vector3d(0.0, 0.0, 0.15)).toRotationMatrix());
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "mounting", warning, "about (");
  EXPECT_NEAR(value_of(report, "dvl0", "mounting", "turn_deg"), 0.15 * 57.3, 0.5);
}

TEST(DvlAgainstImu, FindsLargeMountingError) {
  Dive dive = healthy_dive();
  mount(dive, so3::exp(Vector3d(0.0, 0.0, 1.5708)).toRotationMatrix());
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "mounting", error, "-1.000,");
  EXPECT_NEAR(value_of(report, "dvl0", "mounting", "turn_deg"), 90.0, 1.0);
}

TEST(DvlAgainstImu, FindsLeftHandedAxesWithRotatedMounting) {
  Dive dive = healthy_dive();
  const Eigen::Matrix3d turn = so3::exp(Vector3d(0.0, 0.0, 0.7854)).toRotationMatrix();
  mount(dive, turn * Vector3d(1, 1, -1).asDiagonal());
  make_late(dive.dvl, 0.1);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "mounting", error, "left-handed, signs (1, 1, -1)");
  EXPECT_NEAR(value_of(report, "dvl0", "mounting", "turn_deg"), 45.0, 1.5);
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.1, 0.01);
}

TEST(DvlAgainstImu, IsOkWhenRigHasTheSigns) {
  Dive dive = healthy_dive();
  mount(dive, Vector3d(1, 1, -1).asDiagonal());
  dive.rig.insert(dive.rig.rfind('}'), ", axis_signs: [1, 1, -1]");
  const Report report = examine(dive);
  EXPECT_EQ(report.find("dvl0", "mounting")->severity, Severity::ok) << to_text(report);
  EXPECT_EQ(value_of(report, "dvl0", "mounting", "reversed"), 0.0);
}

TEST(DvlAgainstImu, DetectsAccelerometerReportingGravity) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.accel = -s.accel;
  EXPECT_FINDING(examine(dive), "dvl0", "mounting", error, "an accelerometer that reports gravity");
}

TEST(DvlAgainstImu, FindsWrongScale) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) s.velocity *= 1.15;
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "scale, imu", warning, "sound_speed");
  EXPECT_NEAR(value_of(report, "dvl0", "scale, imu", "low"), 1.0 / 1.15, 0.03);
}

TEST(DvlAgainstImu, ReportsInsufficientMotion) {
  Dive dive = healthy_dive();
  Random random(4);
  for (ImuSample& s : dive.imu) {
    s.gyro = test::normal_vector(random, 0.001);
    s.accel = Vector3d(0.0, 0.0, 9.80665) + test::normal_vector(random, 0.02);
  }
  for (DvlSample& s : dive.dvl)
    s.velocity = Vector3d(0.5, 0, 0) + test::normal_vector(random, 0.003);
  EXPECT_FINDING(examine(dive), "dvl0", "time, imu", note, "cannot be estimated");
}

TEST(DvlAgainstDepth, FindsDelayedStamps) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  make_late(dive.dvl, 0.15);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "time, depth0", warning, "late by 0.1");
  EXPECT_NEAR(value_of(report, "dvl0", "time, depth0", "time_offset_s"), 0.15, 0.03);
}

TEST(DvlAgainstDepth, FindsHeightsInsteadOfDepths) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  for (PressureDepthSample& s : dive.depth) s.depth_m = 20.0 - s.depth_m;
  EXPECT_FINDING(examine(dive), "depth0", "sign", error, "depth falls when the DVL goes down");
}

TEST(DvlAgainstReference, FindsDelayedStamps) {
  Dive dive = long_dive();
  set_reference(dive, 0.0);
  make_late(dive.dvl, 0.3);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "time, reference", warning, "set dvl0.time_offset_s");
  EXPECT_NEAR(value_of(report, "dvl0", "time, reference", "time_offset_s"), 0.3, 0.05);
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.3, 0.02);
}

TEST(DvlAgainstReference, ExplainsDisagreementWithImu) {
  Dive dive = long_dive();
  set_reference(dive, 0.5);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "time, reference", warning, "made with other DVL timing");
  EXPECT_NEAR(value_of(report, "dvl0", "time, reference", "time_offset_s"), 0.5, 0.06);
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.0, 0.02);
}

TEST(DvlAgainstReference, IsSkippedForShortReference) {
  Dive dive = long_dive();
  set_reference(dive, 0.0);
  dive.reference.resize(60);
  EXPECT_EQ(examine(dive).find("dvl0", "time, reference"), nullptr);
}

TEST(InertialPath, MatchesAttitudeAndForceOfSpline) {
  const Se3Spline spline = test::wavy_spline(2, 30.0);
  const Vector3d gravity(0.0, 0.0, -9.80665);
  const InertialPath path(test::imu_along(spline, gravity, 200.0));
  const Motion first = spline.at(spline.start());
  const Motion later = spline.at(spline.start() + Duration::from_seconds(5.0));
  const auto state = path.at(5.0);
  ASSERT_TRUE(state);
  const Eigen::Quaterniond turned =
      first.T_world_body.rotation.conjugate() * later.T_world_body.rotation;
  EXPECT_LT(so3::angle_between(state->R_start_body, turned), 0.02);
  const Vector3d force_change = first.T_world_body.rotation.conjugate() *
                                (later.velocity_world - first.velocity_world - 5.0 * gravity);
  EXPECT_LT((state->force_integral - force_change).norm(), 0.3);
  EXPECT_LT((*path.rate_at(5.0) - later.angular_velocity_body).norm(), 0.02);
}

TEST(InertialPath, IsEmptyInGapsAndOutsideSpan) {
  std::vector<ImuSample> samples = test::imu_along(test::wavy_spline(2, 30.0), {0, 0, -9.8}, 100.0);
  samples.erase(samples.begin() + 1000, samples.begin() + 1100);
  const InertialPath path(samples);
  EXPECT_FALSE(path.at(-0.1));
  EXPECT_FALSE(path.at(10.5));
  EXPECT_FALSE(path.at(1e9));
  EXPECT_FALSE(path.at(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_TRUE(path.is_continuous(1.0, 9.0));
  EXPECT_FALSE(path.is_continuous(9.0, 12.0));
}

TEST(Scan, RefinesMinimumWithParabola) {
  const std::vector<double> at = steps(-1.0, 1.0, 0.1);
  std::vector<double> values;
  values.reserve(at.size());
  for (const double x : at) values.push_back((x - 0.234) * (x - 0.234) + 2.0);
  const Minimum m = find_minimum(at, values);
  EXPECT_TRUE(m.inside);
  EXPECT_NEAR(m.at, 0.234, 1e-9);
  EXPECT_NEAR(m.value, 2.0, 1e-9);
}

TEST(Scan, ReportsMinimumAtTheEnd) {
  EXPECT_FALSE(find_minimum({0.0, 1.0, 2.0}, {3.0, 2.0, 1.0}).inside);
  EXPECT_FALSE(find_minimum({0.0}, {3.0}).inside);
}

}  // namespace
}  // namespace apvi::doctor
