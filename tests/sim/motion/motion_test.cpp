// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/motion.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/tum.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180.0;

MotionContext context(double duration_s) {
  return {.start = Stamp{1'000'000'000},
          .duration_s = duration_s,
          .gravity = 9.80665,
          .seed = 3,
          .height = [](double x, double) { return -10.0 + 0.1 * x; }};
}

MotionConfig steady() {
  MotionConfig config;
  config.origin = {0.0, 0.0, -5.0};
  config.attitude = {.trim_roll_deg = 0.0,
                     .trim_pitch_deg = 0.0,
                     .bank_gain = 0.0,
                     .climb_gain = 0.0,
                     .oscillation_deg = 0.0,
                     .oscillation_period_s = 3.0,
                     .sway_m = 0.0};
  return config;
}

Motion at(const Se3Spline& spline, double t) {
  return spline.at(Stamp{1'000'000'000} + Duration::from_seconds(t));
}

double path_length(const Se3Spline& spline, double duration_s) {
  double length = 0.0;
  for (double t = 0.1; t <= duration_s; t += 0.1) {
    length +=
        (at(spline, t).T_world_body.translation - at(spline, t - 0.1).T_world_body.translation)
            .norm();
  }
  return length;
}

TEST(Motion, HoveringVehicleKeepsItsPose) {
  MotionConfig config = steady();
  config.path = PathKind::hover;
  config.heading_deg = 30.0;
  const Se3Spline spline = plan_motion(config, context(20.0));
  for (const double t : {0.0, 7.3, 20.0}) {
    const Motion motion = at(spline, t);
    EXPECT_LT((motion.T_world_body.translation - Vector3d(0, 0, -5)).norm(), 1e-9);
    EXPECT_LT(motion.velocity_world.norm() + motion.angular_velocity_body.norm(), 1e-9);
    EXPECT_NEAR(so3::yaw(motion.T_world_body.rotation), 30.0 * kDegree, 1e-9);
  }
}

TEST(Motion, CoversDurationWithMarginOnBothSides) {
  const Se3Spline spline = plan_motion(steady(), context(30.0));
  EXPECT_LE(spline.start(), Stamp{1'000'000'000} - Duration::from_seconds(kMotionMargin_s));
  EXPECT_GE(spline.end(), Stamp{1'000'000'000} + Duration::from_seconds(30.0 + kMotionMargin_s));
}

TEST(Motion, CruisesAtConfiguredSpeedHeadingAlongThePath) {
  MotionConfig config = steady();
  config.length_m = 50.0;
  config.heading_deg = 90.0;
  config.speed_m_s = 0.6;
  const Motion motion = at(plan_motion(config, context(40.0)), 30.0);
  EXPECT_NEAR(motion.velocity_world.y(), 0.6, 1e-3);
  EXPECT_NEAR(so3::yaw(motion.T_world_body.rotation), 90.0 * kDegree, 1e-3);
}

TEST(Motion, RestsAtStartAndRespectsMaxTurnRate) {
  MotionConfig config = steady();
  config.max_turn_deg_s = 20.0;
  const Se3Spline spline = plan_motion(config, context(90.0));
  EXPECT_LT(at(spline, 0.5).velocity_world.norm(), 1e-6);
  double fastest = 0.0;
  for (double t = 0.0; t < 90.0; t += 0.05) {
    fastest = std::max(fastest, at(spline, t).angular_velocity_body.norm());
    EXPECT_LT(at(spline, t).velocity_world.norm(), 1.05 * config.speed_m_s);
  }
  EXPECT_GT(fastest, 5.0 * kDegree);
  EXPECT_LT(fastest, 26.0 * kDegree);
}

TEST(Motion, LawnmowerRevisitsItsFirstLine) {
  MotionConfig config = steady();
  config.lines = 2;
  config.length_m = 4.0;
  const Se3Spline spline = plan_motion(config, context(60.0));
  double nearest = 1e9;
  for (double t = 25.0; t < 60.0; t += 0.1) {
    const Vector3d p = at(spline, t).T_world_body.translation;
    nearest = std::min(nearest, (p - Vector3d(2.0, 0.0, -5.0)).norm());
  }
  EXPECT_LT(nearest, 0.2);
}

TEST(Motion, CrossLinesPassOverTheLinesAtRightAngles) {
  MotionConfig config = steady();
  config.lines = 3;
  config.length_m = 8.0;
  config.spacing_m = 4.0;
  config.cross_lines = 2;
  const Se3Spline spline = plan_motion(config, context(120.0));
  for (const double x : {2.0, 6.0}) {
    double nearest_along = 1e9;
    double nearest_across = 1e9;
    for (double t = 5.0; t < 120.0; t += 0.1) {
      const SE3 pose = at(spline, t).T_world_body;
      const double distance = (pose.translation - Vector3d(x, 4.0, -5.0)).norm();
      const double yaw = so3::yaw(pose.rotation);
      if (std::abs(std::sin(yaw)) < 0.05) nearest_along = std::min(nearest_along, distance);
      if (std::abs(std::cos(yaw)) < 0.05) nearest_across = std::min(nearest_across, distance);
    }
    EXPECT_LT(nearest_along, 0.1) << x;
    EXPECT_LT(nearest_across, 0.1) << x;
  }
}

TEST(Motion, FollowsTerrainAtConfiguredAltitude) {
  MotionConfig config = steady();
  config.altitude_m = 2.0;
  config.length_m = 8.0;
  const Se3Spline spline = plan_motion(config, context(20.0));
  const Vector3d p = at(spline, 12.0).T_world_body.translation;
  EXPECT_NEAR(p.z(), -10.0 + 0.1 * p.x() + 2.0, 0.02);
}

TEST(Motion, OrbitKeepsRadiusAndHeadsInward) {
  MotionConfig config = steady();
  config.path = PathKind::orbit;
  config.radius_m = 5.0;
  config.look = HeadingMode::left;
  config.corner_m = 0.3;
  const Se3Spline spline = plan_motion(config, context(60.0));
  for (double t = 10.0; t < 60.0; t += 5.0) {
    const SE3 pose = at(spline, t).T_world_body;
    const Vector3d inward = Vector3d(0, 0, -5) - pose.translation;
    EXPECT_NEAR(inward.norm(), 5.0, 0.1);
    EXPECT_GT((pose.rotation * Vector3d::UnitX()).dot(inward.normalized()), 0.995);
  }
}

TEST(Motion, BanksIntoTurnsAndOscillatesByConfiguredAngle) {
  MotionConfig config = steady();
  config.path = PathKind::hover;
  config.attitude.oscillation_deg = 2.0;
  const Se3Spline spline = plan_motion(config, context(300.0));
  double sum = 0.0;
  int count = 0;
  for (double t = 0.0; t < 300.0; t += 0.1, ++count) {
    const Vector3d left = at(spline, t).T_world_body.rotation * Vector3d::UnitY();
    sum += std::pow(std::asin(left.z()), 2);
  }
  EXPECT_NEAR(std::sqrt(sum / count) / kDegree, 2.0, 0.25);

  config = steady();
  config.path = PathKind::orbit;  // turns left
  config.attitude.bank_gain = 1.0;
  const SE3 pose = at(plan_motion(config, context(30.0)), 20.0).T_world_body;
  EXPECT_LT((pose.rotation * Vector3d::UnitY()).z(), -1e-4);
}

TEST(Motion, SurgesAlongHeadingInPhaseWithStart) {
  MotionConfig config = steady();
  config.path = PathKind::hover;
  config.surge_m = 0.5;
  config.surge_period_s = 8.0;
  const Se3Spline spline = plan_motion(config, context(10.0));
  EXPECT_NEAR(at(spline, 0.0).T_world_body.translation.x(), 0.0, 1e-3);
  EXPECT_NEAR(at(spline, 2.0).T_world_body.translation.x(), 0.5, 2e-3);
}

TEST(Motion, WaveMotionDecaysWithDepth) {
  MotionConfig config = steady();
  config.path = PathKind::hover;
  config.waves.height_m = 1.0;
  const auto heave = [&](double z) {
    config.origin[2] = z;
    const Se3Spline spline = plan_motion(config, context(60.0));
    double largest = 0.0;
    for (double t = 0.0; t < 60.0; t += 0.1) {
      largest = std::max(largest, std::abs(at(spline, t).T_world_body.translation.z() - z));
    }
    return largest;
  };
  const double shallow = heave(-2.0);
  EXPECT_GT(shallow, 0.1);
  // exp(-k 8 m) for the 6 s period, k = 4 pi² / (g T²) = 0.112 / m; components differ a little.
  EXPECT_NEAR(heave(-10.0) / shallow, std::exp(-0.112 * 8.0), 0.08);
}

TEST(Motion, FollowsATrajectoryFile) {
  const test::TmpDir dir;
  Trajectory trajectory;
  for (int i = 0; i <= 100; ++i) {
    const double t = 0.2 * i;
    const Eigen::Quaterniond q(Eigen::AngleAxisd(0.1 * t, Vector3d::UnitZ()));
    trajectory.poses.push_back({Stamp{50'000'000'000} + Duration::from_seconds(t),
                                {q, Vector3d(std::cos(0.3 * t), std::sin(0.3 * t), -4.0)}});
  }
  io::write_tum(dir.path() / "path.tum", trajectory);
  MotionConfig config;
  config.path = PathKind::file;
  config.file = (dir.path() / "path.tum").string();
  const Se3Spline spline = plan_motion(config, context(18.0));
  const Motion motion = at(spline, 10.0);
  EXPECT_LT((motion.T_world_body.translation - Vector3d(std::cos(3.0), std::sin(3.0), -4.0)).norm(),
            0.01);
  EXPECT_NEAR(motion.velocity_world.norm(), 0.3, 0.01);
  EXPECT_NEAR(motion.angular_velocity_body.z(), 0.1, 0.005);
}

TEST(Motion, RejectsInvalidPaths) {
  const test::TmpDir dir;
  const auto message = [](const MotionConfig& config, double duration_s) -> std::string {
    try {
      plan_motion(config, context(duration_s));
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  MotionConfig config;
  config.path = PathKind::file;
  config.file =
      dir.write("short.tum", "0 0 0 -3 0 0 0 1\n1 1 0 -3 0 0 0 1\n2 2 0 -3 0 0 0 1\n").string();
  EXPECT_NE(message(config, 60.0).find("too short: it covers 1.5 s"), std::string::npos);
  config = {};
  config.path = PathKind::waypoints;
  EXPECT_NE(message(config, 60.0).find("motion.waypoints"), std::string::npos);
  config.waypoints = {{1, 1, -3}, {1, 1, -3}};
  EXPECT_NE(message(config, 60.0).find("0.00 m long"), std::string::npos);
}

TEST(Motion, IsDeterministicForASeed) {
  MotionContext other = context(10.0);
  const SE3 once = at(plan_motion({}, context(10.0)), 5.0).T_world_body;
  const SE3 again = at(plan_motion({}, other), 5.0).T_world_body;
  EXPECT_EQ(once.translation, again.translation);
  other.seed = 4;
  EXPECT_NE(once.translation, at(plan_motion({}, other), 5.0).T_world_body.translation);
  EXPECT_GT(path_length(plan_motion({}, context(10.0)), 10.0), 2.0);
}

}  // namespace
}  // namespace apvi::sim
