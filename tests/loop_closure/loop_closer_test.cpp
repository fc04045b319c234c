// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/loop_closer.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "support/textured_floor.hpp"

namespace apvi::loop_closure {
namespace {

constexpr int kKeyframes = 100;
constexpr int kLap = 84;         // keyframes per lap
constexpr double kRadius = 3.0;  // [m]
constexpr double kDrift = 4e-4;  // heading drift per keyframe [rad]

Stamp stamp_of(int i) {
  return Stamp{1'000'000'000 + static_cast<std::int64_t>(i) * 500'000'000};
}

std::size_t index_of(Stamp stamp) {
  return static_cast<std::size_t>((stamp.ns - stamp_of(0).ns) / 500'000'000);
}

SE3 truth(int i) {
  const double a = 2.0 * M_PI * i / kLap;
  return test::camera_looking_down({kRadius * std::cos(a), kRadius * std::sin(a), 2.0}, a);
}

/// Odometry poses with heading drift.
SE3 odometry(int i) {
  Eigen::Vector3d place = truth(0).translation;
  for (int k = 0; k < i; ++k) {
    place += so3::exp({0.0, 0.0, kDrift * k}) * (truth(k + 1).translation - truth(k).translation);
  }
  return {so3::exp({0.0, 0.0, kDrift * i}) * truth(i).rotation, place};
}

Keyframe keyframe(int i, const SE3& T_world_camera) {
  return {.stamp = stamp_of(i),
          .T_world_camera = T_world_camera,
          .drift = {},
          .height_sigma_m = std::nullopt};
}

/// Keyframe poses of a map that applies all corrections.
struct SimulatedRun {
  std::vector<SE3> poses;
  std::size_t closures = 0;
  std::size_t reported = 0;
  bool has_loops_at_flush = false;
  SE3 now;  ///< correction for new keyframes

  void apply(const std::vector<KeyframeCorrection>& keyframe_corrections) {
    if (keyframe_corrections.empty()) return;
    ++reported;
    for (const KeyframeCorrection& moved : keyframe_corrections) {
      SE3& pose = poses.at(index_of(moved.stamp));
      pose = moved.T_after_before * pose;
    }
    EXPECT_EQ(index_of(keyframe_corrections.back().stamp) + 1, poses.size());
    now = keyframe_corrections.back().T_after_before * now;
  }
};

/// No loop is old enough.
LoopOptions never() {
  LoopOptions options;
  options.min_age_s = 1000.0;
  return options;
}

SimulatedRun simulate(const CloserOptions& options, int keyframes) {
  LoopCloser closer(options, test::floor_camera());
  SimulatedRun result;
  for (int i = 0; i < keyframes; ++i) {
    result.poses.push_back(result.now * odometry(i));
    const bool changed = closer.add(keyframe(i, odometry(i)), test::render_floor(truth(i)));
    if (changed) result.apply(closer.changed_corrections());
  }
  result.has_loops_at_flush = closer.flush();
  if (result.has_loops_at_flush) result.apply(closer.changed_corrections());
  EXPECT_FALSE(closer.flush());
  result.closures = closer.closures();
  EXPECT_EQ(closer.loops().size(), closer.closures());
  for (const ClosedLoop& loop : closer.loops()) EXPECT_LT(loop.from, loop.to);
  EXPECT_EQ(closer.loops(closer.closures()).size(), 0U);
  return result;
}

SimulatedRun simulate(const LoopOptions& options, int keyframes) {
  return simulate(closer_options(options), keyframes);
}

double max_position_error(const std::vector<SE3>& poses) {
  double largest = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const SE3 there = truth(static_cast<int>(i));
    largest = std::max(largest, (poses[i].translation - there.translation).norm());
  }
  return largest;
}

TEST(LoopCloser, CorrectsDriftOverALap) {
  const SimulatedRun open = simulate(never(), kKeyframes);
  EXPECT_EQ(open.closures, 0U);
  EXPECT_EQ(open.reported, 0U);
  const SimulatedRun closed = simulate(LoopOptions{}, kKeyframes);
  EXPECT_GT(closed.closures, 5U);
  ASSERT_GT(max_position_error(open.poses), 0.1);
  EXPECT_LT(max_position_error(closed.poses), 0.35 * max_position_error(open.poses));
  const SE3 last = closed.poses.back();
  EXPECT_LT(so3::angle_between(last.rotation, truth(kKeyframes - 1).rotation), 0.01);
  EXPECT_LT(closed.reported, 10U);  // few optimizations
}

// Loops found within 4 s of the last optimization are pending.
TEST(LoopCloser, FlushReportsPendingLoops) {
  CloserOptions options = closer_options(LoopOptions{});
  options.min_news_sigmas = 0.0;
  const SimulatedRun end = simulate(options, kLap + 2);
  EXPECT_TRUE(end.has_loops_at_flush);
  EXPECT_LT(max_position_error(end.poses), 0.03);
}

TEST(LoopCloser, ReportsNothingWithoutARevisit) {
  const SimulatedRun part = simulate(LoopOptions{}, kLap / 2);
  EXPECT_EQ(part.closures, 0U);
  EXPECT_EQ(part.reported, 0U);
}

TEST(LoopCloser, ClosesLoopsWithALimitedNumberOfPlaces) {
  LoopOptions few_places;
  few_places.max_places = 40;
  const SimulatedRun closed = simulate(few_places, kKeyframes);
  EXPECT_GT(closed.closures, 0U);
  EXPECT_LT(max_position_error(closed.poses),
            0.5 * max_position_error(simulate(never(), kKeyframes).poses));
}

TEST(LoopCloser, IgnoresRepeatedAndOutOfOrderKeyframes) {
  LoopCloser closer(closer_options(LoopOptions{}), test::floor_camera());
  const cv::Mat image = test::render_floor(truth(0));
  closer.add(keyframe(3, odometry(3)), image);
  EXPECT_FALSE(closer.add(keyframe(3, odometry(3)), image));
  EXPECT_FALSE(closer.add(keyframe(2, odometry(2)), image));
  EXPECT_EQ(closer.graph().size(), 1U);
  closer.update_pose(stamp_of(77), odometry(77));  // unknown keyframes are ignored
}

constexpr int kLookAlike = 20;  // keyframes over each of two places
constexpr int kDetour = 100;    // keyframes without an image between them
constexpr double kDetour_m = 100.0;
constexpr double kApart_m = 5.0;   // of the two places
constexpr double kHeight_m = 7.0;  // so that the other place is in view

SE3 above(double x, double y) {
  return test::camera_looking_down({x, y, kHeight_m}, 0.0);
}

/// A place, a detour, and a place that looks the same `apart_m` beside the first, with exact
/// odometry that may have drifted by `sigma_m` in between.
LoopCloser visit_look_alike_places(double gate, double apart_m, double sigma_m) {
  SmoothingOptions options;
  options.gate = gate;
  LoopCloser closer(closer_options(options), test::floor_camera());
  int index = 0;
  const auto add = [&](const SE3& pose, const cv::Mat& image) {
    Keyframe next = keyframe(index++, pose);
    next.drift = {.heading = 1e-9, .horizontal = sigma_m * sigma_m / kDetour, .vertical = 1e-7};
    closer.add(next, image);
  };
  for (const double x0 : {0.0, apart_m}) {
    for (int k = 0; k < kLookAlike; ++k) {
      const int from_middle = k - kLookAlike / 2;
      const double x = 0.1 * from_middle;
      add(above(x0 + x, 0.0), test::render_floor(above(x, 0.0)));
    }
    for (int k = 0; x0 == 0.0 && k < kDetour; ++k) {
      const double away = 0.5 * kDetour_m * (1.0 - std::abs(1.0 - 2.0 * k / kDetour));
      add(above(x0, away), {});
    }
  }
  closer.flush();
  return closer;
}

double newest_shift_m(const LoopCloser& closer) {
  const std::size_t newest = closer.graph().newest();
  return (closer.graph().corrected_pose(newest).translation -
          closer.graph()[newest].T_world_camera.translation)
      .norm();
}

TEST(LoopCloser, RejectsALookAlikePlaceThatTheGraphContradicts) {
  const double gate = SmoothingOptions{}.gate;
  for (const double sigma_m : {0.03, 0.3, 1.0}) {
    const LoopCloser open = visit_look_alike_places(1e9, kApart_m, sigma_m);
    ASSERT_GT(open.closures(), 0U);  // the images alone do not tell
    const LoopCloser gated = visit_look_alike_places(gate, kApart_m, sigma_m);
    EXPECT_EQ(gated.closures(), 0U) << sigma_m;
    EXPECT_GT(gated.rejected(), 0U) << sigma_m;
    EXPECT_EQ(newest_shift_m(gated), 0.0) << sigma_m;
  }
  EXPECT_GT(newest_shift_m(visit_look_alike_places(1e9, kApart_m, 1.0)), 0.5);
}

TEST(LoopCloser, AcceptsAPlaceWhereTheGraphExpectsIt) {
  const LoopCloser same = visit_look_alike_places(SmoothingOptions{}.gate, 0.0, 0.03);
  EXPECT_GT(same.closures(), 5U);
  EXPECT_EQ(same.rejected(), 0U);
  EXPECT_LT(newest_shift_m(same), 0.02);
}

/// A lap with drift and what its images tell, to the end.
LoopCloser finished_lap(const CloserOptions& options) {
  LoopCloser closer(options, test::floor_camera());
  for (int i = 0; i < kKeyframes; ++i) {
    Keyframe added = keyframe(i, odometry(i));
    added.drift = {.heading = 1e-5, .horizontal = 1e-5, .vertical = 1e-5};
    closer.add(added, test::render_floor(truth(i)));
  }
  closer.finish();
  closer.adjust();
  return closer;
}

double rms_position_error(const LoopCloser& closer) {
  double sum = 0.0;
  for (int i = 0; i < kKeyframes; ++i) {
    const SE3 pose = closer.corrected_pose(static_cast<std::size_t>(i));
    sum += (pose.translation - truth(i).translation).squaredNorm();
  }
  return std::sqrt(sum / kKeyframes);
}

TEST(LoopCloser, TheBundleAdjustmentAtTheEndImprovesTheGraph) {
  CloserOptions options = closer_options(SmoothingOptions{});
  options.drift_factor = 1.0;
  options.adjusts_bundle = false;
  const LoopCloser graph = finished_lap(options);
  options.adjusts_bundle = true;
  LoopCloser bundle = finished_lap(options);
  ASSERT_GT(graph.closures(), 5U);
  EXPECT_LT(rms_position_error(bundle), 0.7 * rms_position_error(graph));
  EXPECT_FALSE(bundle.changed_corrections().empty());
  EXPECT_TRUE(bundle.adjusted_camera());
  EXPECT_FALSE(graph.adjusted_camera());
  const SE3 shown = bundle.corrected_pose(50) * bundle.T_body_camera(50).inverse();
  EXPECT_LT((shown.translation - truth(50).translation).norm(), 0.05);
}

}  // namespace
}  // namespace apvi::loop_closure
