// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/keyframe_graph.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kStep_s = 0.5;

Stamp stamp_of(std::size_t i) {
  return Stamp{} + Duration::from_seconds(kStep_s * static_cast<double>(i));
}

/// Two laps on a circle.
SE3 truth(std::size_t i) {
  const double a = 2.0 * M_PI * static_cast<double>(i) / 100.0;
  return {so3::exp({0.0, 0.0, a}), {5.0 * std::cos(a), 5.0 * std::sin(a), -2.0}};
}

SE3 drifted(std::size_t i) {
  const double t = static_cast<double>(i);
  return SE3{so3::exp({0.0, 0.0, 2e-4 * t}), {1e-3 * t, -5e-4 * t, 0.0}} * truth(i);
}

KeyframeGraph two_laps(const KeyframeGraphOptions& options) {
  KeyframeGraph graph(options);
  for (std::size_t i = 0; i < 200; ++i) {
    graph.add({.stamp = stamp_of(i),
               .T_world_camera = drifted(i),
               .drift = {.heading = 1e-6, .horizontal = 1e-5, .vertical = 1e-6},
               .height_sigma_m = 0.01});
  }
  for (std::size_t i = 0; i < 100; i += 5) {
    graph.add(Loop{i, i + 100, truth(i).inverse() * truth(i + 100)});
  }
  graph.optimize();
  return graph;
}

double largest_error(const KeyframeGraph& graph) {
  double largest = 0.0;
  for (std::size_t i = 0; i < graph.size(); ++i) {
    largest = std::max(
        largest, (graph.corrected_pose(i).translation - graph.corrected_pose(i % 100).translation -
                  truth(i).translation + truth(i % 100).translation)
                     .norm());
  }
  return largest;
}

TEST(KeyframeGraph, LoopsRemoveTheDriftBetweenTwoLaps) {
  const KeyframeGraph graph = two_laps({.node_step_s = 1.0});
  ASSERT_GT((drifted(199).translation - drifted(99).translation).norm(), 0.1);
  EXPECT_LT(largest_error(graph), 0.01);
}

TEST(KeyframeGraph, WorkIsBoundedByTheNumberOfNodes) {
  const KeyframeGraph graph = two_laps({.node_step_s = 1.0, .max_nodes = 20});
  EXPECT_EQ(graph.size(), 200U);
  EXPECT_LE(graph.nodes(), 20U);
  EXPECT_LT(largest_error(graph), 0.05);
}

TEST(KeyframeGraph, RefiningUsesTheNodesAndLoopsThatWereLeftOut) {
  KeyframeGraph bounded = two_laps({.node_step_s = 1.0, .max_nodes = 20});
  const KeyframeGraph full = two_laps({.node_step_s = 1.0});
  EXPECT_TRUE(bounded.refine());
  EXPECT_EQ(bounded.nodes(), full.nodes());
  for (std::size_t i = 0; i < full.size(); ++i) {
    const SE3 difference = full.corrected_pose(i).inverse() * bounded.corrected_pose(i);
    EXPECT_LT(difference.translation.norm(), 1e-3) << i;
  }
  EXPECT_FALSE(bounded.refine());
}

TEST(KeyframeGraph, CorrectionsAreContinuousBetweenNodes) {
  const KeyframeGraph graph = two_laps({.node_step_s = 4.0});
  for (std::size_t i = 1; i < graph.size(); ++i) {
    const SE3 step = graph.corrected_pose(i - 1).inverse() * graph.corrected_pose(i);
    const SE3 odometry = drifted(i - 1).inverse() * drifted(i);
    EXPECT_LT((step.translation - odometry.translation).norm(), 0.01) << i;
  }
}

TEST(KeyframeGraph, DistanceGrowsWithTheErrorOfALoop) {
  const KeyframeGraph graph = two_laps({.node_step_s = 1.0});
  Loop loop{2, 102, truth(2).inverse() * truth(102)};
  EXPECT_LT(graph.check(loop).squared_distance, 4.0);
  loop.T_from_to.translation.x() += 0.1;
  EXPECT_GT(graph.check(loop).squared_distance, 50.0);
}

TEST(KeyframeGraph, ALoopCountsFromTheNextOptimizationOn) {
  KeyframeGraph graph = two_laps({.node_step_s = 1.0});
  const Loop loop{50, 150, truth(50).inverse() * truth(150)};
  const Loop next{51, 151, truth(51).inverse() * truth(151)};
  const double before = graph.check(next).news;
  graph.add(loop);
  EXPECT_EQ(graph.check(next).news, before);
  graph.optimize();
  EXPECT_LT(graph.check(next).news, before);
}

// Nodes beside a break stay when others are thinned out.
TEST(KeyframeGraph, NoCorrectionIsInterpolatedOverABreak) {
  constexpr std::size_t kBreak = 51;
  const SE3 moved{so3::exp({0.0, 0.0, 1.0}), {3.0, 4.0, 5.0}};
  const auto corrected = [&](std::size_t i) { return (i < kBreak ? SE3{} : moved) * truth(i); };
  KeyframeGraph graph({.node_step_s = 4.0, .max_nodes = 10});
  for (std::size_t i = 0; i < 200; ++i) {
    const DriftVariance known{.heading = 1e-6, .horizontal = 1e-5, .vertical = 1e-6};
    const DriftVariance unknown{.heading = 3.0, .horizontal = 100.0, .vertical = 100.0};
    graph.add({.stamp = stamp_of(i),
               .T_world_camera = truth(i),
               .drift = i == kBreak ? unknown : known,
               .height_sigma_m = {}});
  }
  ASSERT_LE(graph.nodes(), 10U);
  graph.place_since(kBreak, moved);
  for (const std::size_t i : {60U, 150U}) {
    graph.add(Loop{i - 50, i, corrected(i - 50).inverse() * corrected(i)});
  }
  for (const bool refined : {false, true}) {
    if (refined) graph.refine();
    for (std::size_t i = 0; i < graph.size(); ++i) {
      const Eigen::Vector3d error = graph.corrected_pose(i).translation - corrected(i).translation;
      EXPECT_LT(error.norm(), 1e-3) << i;
    }
  }
}

}  // namespace
}  // namespace apvi::loop_closure
