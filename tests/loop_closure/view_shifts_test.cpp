// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/view_shifts.hpp"

#include <gtest/gtest.h>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

// Keyframes a second apart. The path is broken before `broken`.
KeyframeGraph graph_of(std::size_t keyframes, std::size_t broken = 0) {
  KeyframeGraph graph({.node_step_s = 1.0});
  for (std::size_t k = 0; k < keyframes; ++k) {
    Keyframe keyframe;
    keyframe.stamp = Stamp{static_cast<std::int64_t>(k) * 1'000'000'000};
    keyframe.T_world_camera.translation.x() = static_cast<double>(k);
    keyframe.drift.horizontal = k > 0 && k == broken ? 100.0 : 1e-6;
    graph.add(keyframe);
  }
  return graph;
}

SE3 at(double x, double y, double heading = 0.0) {
  return {so3::exp({0.0, 0.0, heading}), {x, y, 0.0}};
}

double y_of(const ViewShifts& shifts, const KeyframeGraph& graph, std::size_t k) {
  return shifts.moved(graph, k, graph.corrected_pose(k)).translation.y();
}

TEST(ViewShifts, AShiftIsLinearInTimeBetweenViews) {
  const KeyframeGraph graph = graph_of(8);
  ViewShifts shifts;
  shifts.add(2, at(2.0, 0.0), at(2.0, 0.1, 0.2));
  shifts.add(6, at(6.0, 0.0), at(6.0, 0.3, 0.4));
  EXPECT_NEAR(y_of(shifts, graph, 3), 0.15, 1e-12);
  EXPECT_NEAR(so3::yaw(shifts.moved(graph, 4, at(4.0, 0.0)).rotation), 0.3, 1e-12);
}

TEST(ViewShifts, BeforeTheFirstAndAfterTheLastViewTheShiftIsTheirs) {
  const KeyframeGraph graph = graph_of(8);
  ViewShifts shifts;
  shifts.add(2, at(2.0, 0.0), at(2.0, 0.1));
  shifts.add(6, at(6.0, 0.0), at(6.0, 0.3));
  EXPECT_NEAR(y_of(shifts, graph, 0), 0.1, 1e-12);
  EXPECT_NEAR(y_of(shifts, graph, 7), 0.3, 1e-12);
}

TEST(ViewShifts, AShiftDoesNotReachOverABreak) {
  const KeyframeGraph graph = graph_of(8, 5);
  ViewShifts shifts;
  shifts.add(2, at(2.0, 0.0), at(2.0, 0.1));
  EXPECT_NEAR(y_of(shifts, graph, 4), 0.1, 1e-12);
  EXPECT_EQ(y_of(shifts, graph, 5), 0.0);
  shifts.add(6, at(6.0, 0.0), at(6.0, 0.3));
  EXPECT_NEAR(y_of(shifts, graph, 4), 0.1, 1e-12);
  EXPECT_NEAR(y_of(shifts, graph, 5), 0.3, 1e-12);
}

TEST(ViewShifts, WithoutViewsNothingMoves) {
  const KeyframeGraph graph = graph_of(3);
  EXPECT_EQ(y_of({}, graph, 1), 0.0);
}

}  // namespace
}  // namespace apvi::loop_closure
