// SPDX-License-Identifier: BSD-3-Clause
#include "eval/trajectory_metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "support/matchers.hpp"

namespace apvi::eval {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using std::numbers::pi;

constexpr double kDegree = pi / 180.0;

// `count` poses `pose_at(t)` at 10 Hz.
template <typename F>
Trajectory sampled(int count, const F& pose_at) {
  Trajectory t;
  for (int i = 0; i < count; ++i) {
    t.poses.push_back({Stamp{1'000'000'000 + 100'000'000LL * i}, pose_at(0.1 * i)});
  }
  return t;
}

// One revolution of a circle with radius 10 m, 100 evenly spaced poses, x axis along the path.
Trajectory circle(double radius = 10.0) {
  return sampled(100, [=](double t) {
    const double angle = 2.0 * pi * t / 10.0;
    return SE3{so3::exp(Vector3d(0, 0, angle + pi / 2)),
               radius * Vector3d(std::cos(angle), std::sin(angle), 0.0)};
  });
}

// A three-dimensional curve without symmetry.
Trajectory curl(int count = 300) {
  return sampled(count, [](double t) {
    return SE3{so3::exp(Vector3d(0.2 * std::sin(t), 0.1, 0.3 * t)),
               Vector3d(3.0 * std::sin(0.4 * t), 0.02 * t * t, 1.0 + std::sin(0.9 * t))};
  });
}

Trajectory moved(const SE3& T, Trajectory trajectory) {
  for (StampedPose& pose : trajectory.poses) pose.T_world_body = T * pose.T_world_body;
  return trajectory;
}

Trajectory positions_only(Trajectory trajectory, bool has_height) {
  trajectory.has_rotation = false;
  trajectory.has_height = has_height;
  for (StampedPose& pose : trajectory.poses) {
    pose.T_world_body.rotation = Quaterniond::Identity();
    if (!has_height) pose.T_world_body.translation.z() = 0.0;
  }
  return trajectory;
}

EvalOptions aligned(Alignment alignment) {
  EvalOptions options;
  options.alignment = alignment;
  return options;
}

const SE3 kMotion{so3::exp(Vector3d(0.3, -0.9, 2.0)), Vector3d(100.0, -20.0, 3.0)};

TEST(TrajectoryMetrics, RigidlyTransformedCopyHasZeroError) {
  const TrajectoryMetrics m = evaluate(curl(), moved(kMotion, curl()));
  EXPECT_LT(m.ate.value->max, 1e-12);
  EXPECT_LT(m.ate_first_pose.value->max, 1e-12);
  EXPECT_LT(m.rotation_deg.value->max, 1e-10);
  EXPECT_LT(m.rpe_time.value->max, 1e-12);
  EXPECT_LT(m.rpe_distance.value->max, 1e-12);
  EXPECT_LT(m.rpe_distance_all_pairs.value->max, 1e-12);
  EXPECT_EQ(m.matched, 300u);
  EXPECT_EQ(m.coverage, 1.0);
  EXPECT_NEAR(*m.path_length_m, curl().path_length(), 1e-12);
}

TEST(TrajectoryMetrics, ErrorOfScaledCircleIsRadiusDifference) {
  const TrajectoryMetrics m = evaluate(circle(10.0), moved(kMotion, circle(10.25)));
  EXPECT_NEAR(m.ate.value->min, 0.25, 1e-12);
  EXPECT_NEAR(m.ate.value->max, 0.25, 1e-12);
  EXPECT_NEAR(m.ate.value->std, 0.0, 1e-12);
  EXPECT_NEAR(*m.path_length_m, 99 * 20.0 * std::sin(pi / 100), 1e-9);
  EXPECT_NEAR(*m.ate_percent_of_path, 100.0 * 0.25 / *m.path_length_m, 1e-12);
}

TEST(TrajectoryMetrics, OffsetIsErrorWithoutAlignment) {
  const SE3 offset{{1, 0, 0, 0}, Vector3d(3.0, 0.0, 4.0)};
  const TrajectoryMetrics m = evaluate(curl(), moved(offset, curl()), aligned(Alignment::none));
  EXPECT_NEAR(m.ate.value->rmse, 5.0, 1e-12);
  EXPECT_LT(m.rotation_deg.value->max, 1e-10);
}

TEST(TrajectoryMetrics, YawAlignmentRemovesHeadingAndOffsetButNotTilt) {
  const SE3 heading{so3::exp(Vector3d(0, 0, 2.5)), Vector3d(5, 6, 7)};
  EXPECT_LT(evaluate(curl(), moved(heading, curl()), aligned(Alignment::yaw)).ate.value->max,
            1e-12);
  const SE3 tilt{so3::exp(Vector3d(2.0 * kDegree, 0, 0)), Vector3d::Zero()};
  const TrajectoryMetrics m = evaluate(circle(), moved(tilt, circle()), aligned(Alignment::yaw));
  // The tilt lifts y = 10 sin by sin(2 deg): 10 sin(2 deg) / sqrt(2) of height, and shrinks y.
  EXPECT_NEAR(m.ate.value->rmse, 10.0 * std::sqrt(2.0) * std::sin(1.0 * kDegree), 1e-4);
  EXPECT_NEAR(m.rotation_deg.value->rmse, 2.0, 1e-9);
}

TEST(TrajectoryMetrics, HeadingErrorGrowsWithDistanceForFirstPoseAlignment) {
  const auto straight = [](double heading) {
    return sampled(101, [=](double t) {
      const Quaterniond q = so3::exp(Vector3d(0, 0, t > 0.0 ? heading : 0.0));
      return SE3{q, q * Vector3d(2.0 * t, 0.0, 0.0)};
    });
  };
  const double heading = 3.0 * kDegree;
  const TrajectoryMetrics m = evaluate(straight(0.0), straight(heading));
  EXPECT_NEAR(m.ate_first_pose.value->max, 2.0 * 20.0 * std::sin(0.5 * heading), 1e-12);
  EXPECT_EQ(m.ate_first_pose.value->min, 0.0);
  const TrajectoryMetrics first =
      evaluate(straight(0.0), straight(heading), aligned(Alignment::first));
  EXPECT_EQ(first.ate.value->rmse, first.ate_first_pose.value->rmse);
}

TEST(TrajectoryMetrics, BodyRotationAffectsOnlyRotationError) {
  Trajectory estimate = curl();
  for (StampedPose& pose : estimate.poses) {
    pose.T_world_body.rotation =
        pose.T_world_body.rotation * so3::exp(Vector3d(0, 5.0 * kDegree, 0));
  }
  const TrajectoryMetrics m = evaluate(curl(), moved(kMotion, estimate));
  EXPECT_LT(m.ate.value->max, 1e-12);
  EXPECT_NEAR(m.rotation_deg.value->rmse, 5.0, 1e-10);
  EXPECT_NEAR(m.rotation_deg.value->std, 0.0, 1e-10);
}

TEST(TrajectoryMetrics, SpeedScaleErrorAffectsRelativeErrors) {
  const auto straight = [](double speed) {
    return sampled(301, [=](double t) { return SE3{{1, 0, 0, 0}, Vector3d(speed * t, 0, 0)}; });
  };
  const TrajectoryMetrics m = evaluate(straight(2.0), straight(2.0 * 1.03));
  EXPECT_NEAR(m.rpe_time.value->rmse, 0.06, 1e-12);
  EXPECT_EQ(m.rpe_time.value->count, 291u);
  // 10 m of the estimate are 49 steps of 0.206 m: six such segments in 300 steps, the first one
  // unused.
  EXPECT_NEAR(m.rpe_distance.value->rmse, 49 * 0.006, 1e-9);
  EXPECT_EQ(m.rpe_distance.value->count, 5u);
  // The last poses have 44 to 48 steps to the end, which is also within 1 m of 10 m.
  double squares = 252 * std::pow(49 * 0.006, 2);
  for (int steps = 44; steps <= 48; ++steps) squares += std::pow(steps * 0.006, 2);
  EXPECT_EQ(m.rpe_distance_all_pairs.value->count, 257u);
  EXPECT_NEAR(m.rpe_distance_all_pairs.value->rmse, std::sqrt(squares / 257), 1e-9);
}

TEST(TrajectoryMetrics, RelativeErrorsAreMissingForShortPath) {
  const TrajectoryMetrics m = evaluate(curl(8), curl(8));  // 0.7 s
  EXPECT_EQ(m.rpe_time.reason, Reason::too_short);
  EXPECT_EQ(m.rpe_distance.reason, Reason::too_short);
  EXPECT_FALSE(m.rpe_distance.value);
  EXPECT_TRUE(m.ate.value);
}

TEST(TrajectoryMetrics, CollinearPositionsHavePositionErrorOnly) {
  const auto line = [](double scale) {
    return sampled(101, [=](double t) { return SE3{{1, 0, 0, 0}, Vector3d(scale * t, 0, 0)}; });
  };
  const TrajectoryMetrics m = evaluate(line(1.0), moved(kMotion, line(1.1)));
  // A line 10 % too long, aligned at the center: errors are uniform from 0 to 0.5 m.
  EXPECT_NEAR(m.ate.value->max, 0.5, 1e-9);
  EXPECT_NEAR(m.ate.value->min, 0.0, 1e-9);
  EXPECT_EQ(m.rotation_deg.reason, Reason::undetermined);
  EXPECT_FALSE(m.rotation_deg.value);
}

TEST(TrajectoryMetrics, ErrorOfStationaryEstimateIsPathExtent) {
  const Trajectory still = sampled(100, [](double) { return SE3::identity(); });
  const TrajectoryMetrics m = evaluate(circle(10.0), still);
  EXPECT_NEAR(m.ate.value->rmse, 10.0, 1e-9);
  EXPECT_EQ(m.rpe_distance.reason, Reason::too_short);
  EXPECT_NEAR(evaluate(circle(10.0), still, aligned(Alignment::yaw)).ate.value->rmse, 10.0, 1e-9);
}

TEST(TrajectoryMetrics, StationaryReferenceHasNoPercentOfPath) {
  const Trajectory still = sampled(100, [](double) { return SE3::identity(); });
  const TrajectoryMetrics m = evaluate(still, circle(1.0));
  EXPECT_EQ(m.path_length_m, 0.0);
  EXPECT_FALSE(m.ate_percent_of_path);
}

// The same poses in north-east-down, written explicitly.
Trajectory curl_in_ned() {
  Trajectory t = curl();
  const Eigen::Matrix3d swap{{0, 1, 0}, {1, 0, 0}, {0, 0, -1}};
  for (StampedPose& pose : t.poses) {
    pose.T_world_body.translation = swap * pose.T_world_body.translation;
    pose.T_world_body.rotation = Quaterniond(Eigen::Matrix3d(swap * pose.T_world_body.rotation));
  }
  return t;
}

TEST(TrajectoryMetrics, NedEstimateMatchesGnssOnlyWithWorldFrameSet) {
  const Trajectory gnss = positions_only(curl(), false);
  EvalOptions options;
  options.estimate_world = WorldFrame::ned;
  EXPECT_LT(evaluate(gnss, curl_in_ned(), options).ate.value->max, 1e-12);
  EXPECT_GT(evaluate(gnss, curl_in_ned()).ate.value->rmse, 1.0);  // its mirror image does not fit
}

TEST(TrajectoryMetrics, ConvertsWorldFramesOfEitherTrajectory) {
  EvalOptions options = aligned(Alignment::none);
  options.reference_world = WorldFrame::ned;
  const TrajectoryMetrics m = evaluate(curl_in_ned(), curl(), options);
  EXPECT_LT(m.ate.value->max, 1e-12);
  EXPECT_LT(m.rotation_deg.value->max, 1e-10);
}

TEST(TrajectoryMetrics, PlanarReferenceIgnoresHeight) {
  Trajectory estimate = curl();
  for (StampedPose& pose : estimate.poses) pose.T_world_body.translation.z() *= 50.0;
  const SE3 heading{so3::exp(Vector3d(0, 0, 1.0)), Vector3d(5, 6, 700)};
  const TrajectoryMetrics m = evaluate(positions_only(curl(), false), moved(heading, estimate));
  EXPECT_LT(m.ate.value->max, 1e-12);
  EXPECT_LT(*m.path_length_m, curl().path_length());
}

TEST(TrajectoryMetrics, PositionsOnlyGiveNoRotationError) {
  const TrajectoryMetrics m = evaluate(positions_only(curl(), true), moved(kMotion, curl()));
  EXPECT_LT(m.ate.value->max, 1e-12);
  for (const ErrorMetric& metric :
       {m.rotation_deg, m.ate_first_pose, m.rpe_time, m.rpe_distance, m.rpe_distance_all_pairs}) {
    EXPECT_FALSE(metric.value);
    EXPECT_EQ(metric.reason, Reason::no_orientation);
  }
  EXPECT_EQ(evaluate(positions_only(curl(), true), curl(), aligned(Alignment::first)).ate.reason,
            Reason::no_orientation);
}

TEST(TrajectoryMetrics, ReportsMissingTimeOverlap) {
  Trajectory later = curl();
  for (StampedPose& pose : later.poses) pose.stamp = pose.stamp + Duration{100'000'000'000};
  const TrajectoryMetrics m = evaluate(curl(), later);
  EXPECT_EQ(m.ate.reason, Reason::no_overlap);
  EXPECT_EQ(m.rpe_time.reason, Reason::no_overlap);
  EXPECT_FALSE(m.path_length_m);
  EXPECT_EQ(m.matched, 0u);
  EXPECT_EQ(m.coverage, 0.0);
  EXPECT_THAT(describe_spans(curl(), later), testing::HasSubstr("(70.100 s apart)"));
}

TEST(TrajectoryMetrics, TwoPosesSufficeForYawButNotForSe3) {
  const TrajectoryMetrics m = evaluate(curl(), curl(2));
  EXPECT_EQ(m.ate.reason, Reason::too_few_matches);
  EXPECT_EQ(m.ate_first_pose.reason, Reason::too_few_matches);
  EXPECT_EQ(m.matched, 2u);
  EXPECT_TRUE(evaluate(curl(), curl(2), aligned(Alignment::yaw)).ate.value);
}

TEST(TrajectoryMetrics, EmptyTrajectoriesHaveNoOverlap) {
  EXPECT_EQ(evaluate(Trajectory{}, curl()).ate.reason, Reason::no_overlap);
  EXPECT_EQ(evaluate(curl(), Trajectory{}).ate.reason, Reason::no_overlap);
  EXPECT_FALSE(evaluate(curl(), Trajectory{}).end_to_start_m);
}

TEST(TrajectoryMetrics, NonFinitePosesCountAsMissing) {
  Trajectory estimate = curl();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = 100; i < 150; ++i) estimate.poses[i].T_world_body.translation.x() = kNan;
  estimate.poses[0].T_world_body.rotation.w() = std::numeric_limits<double>::infinity();
  const TrajectoryMetrics m = evaluate(curl(), estimate);
  EXPECT_EQ(m.matched, 249u);
  EXPECT_LT(m.ate.value->max, 1e-12);
  EXPECT_NEAR(*m.coverage, 1.0 - 5.2 / 29.9, 1e-9);  // 5.1 s inside and 0.1 s at the start
  EXPECT_TRUE(std::isfinite(*m.end_to_start_m));
}

TEST(TrajectoryMetrics, EvaluatesClosedLoopWithoutReference) {
  Trajectory loop = circle(10.0);
  loop.poses.push_back({Stamp{12'000'000'000}, {{1, 0, 0, 0}, Vector3d(10.0, 0.3, 0.4)}});
  const TrajectoryMetrics m = evaluate_without_reference(loop);
  EXPECT_NEAR(*m.end_to_start_m, 0.5, 1e-12);
  EXPECT_NEAR(*m.estimate_length_m, loop.path_length(), 1e-12);
  EXPECT_FALSE(m.matched);
  EXPECT_FALSE(m.ate.value);
}

TEST(ReferenceWorld, IsVehicleFrameUnlessPositionsOnly) {
  EXPECT_EQ(reference_world(curl(), WorldFrame::ned), WorldFrame::ned);
  EXPECT_EQ(reference_world(positions_only(curl(), true), WorldFrame::ned), WorldFrame::up);
}

TEST(Within, IncludesBothEnds) {
  const Trajectory part = within(curl(), Stamp{1'100'000'000}, Stamp{1'400'000'000});
  ASSERT_EQ(part.size(), 4u);
  EXPECT_EQ(part.poses.front().stamp.ns, 1'100'000'000);
  EXPECT_EQ(part.poses.back().stamp.ns, 1'400'000'000);
}

TEST(TrajectoryMetrics, Sim3ComparesAnEstimateUpToScale) {
  const Trajectory reference = curl();
  Trajectory estimate = moved({so3::exp(Vector3d(0.1, 0.2, 0.3)), Vector3d(4, 5, 6)}, reference);
  for (StampedPose& pose : estimate.poses) pose.T_world_body.translation *= 0.25;
  EvalOptions options;
  options.alignment = Alignment::sim3;
  const TrajectoryMetrics metrics = evaluate(reference, estimate, options);
  EXPECT_NEAR(metrics.scale_to_reference.value(), 4.0, 1e-9);
  EXPECT_NEAR(metrics.ate.value->rmse, 0.0, 1e-9);
  EXPECT_NEAR(metrics.rpe_time.value->rmse, 0.0, 1e-9);
  EXPECT_GT(evaluate(reference, estimate).ate.value->rmse, 0.5);
}

}  // namespace
}  // namespace apvi::eval
