// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/pose_graph.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <vector>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kPoses = 80;
constexpr double kTurn = 2.0 * M_PI / 72.0;

/// A little more than one lap on a circle of 6 m, climbing, slightly tilted, looking along the
/// path.
std::vector<SE3> circle() {
  std::vector<SE3> poses;
  for (std::size_t i = 0; i < kPoses; ++i) {
    const double a = kTurn * static_cast<double>(i);
    poses.push_back({so3::exp({0.0, 0.0, a}) * so3::exp({0.05, -0.1, 0.0}),
                     {6.0 * std::cos(a), 6.0 * std::sin(a), 0.01 * static_cast<double>(i)}});
  }
  return poses;
}

/// Odometry poses that turn too much at every step.
std::vector<SE3> drifted(const std::vector<SE3>& truth, double turn, const Eigen::Vector3d& step) {
  std::vector<SE3> poses = {truth[0]};
  for (std::size_t i = 1; i < truth.size(); ++i) {
    const SE3 T_before_now = truth[i - 1].inverse() * truth[i];
    // About the vertical only; tilt does not drift.
    const SE3 before = poses.back();
    const SE3 heading{so3::exp({0.0, 0.0, turn * static_cast<double>(i)}), Eigen::Vector3d::Zero()};
    const Eigen::Vector3d moved = before.rotation * T_before_now.translation + step;
    poses.push_back(
        {(heading.rotation * truth[i].rotation).normalized(), before.translation + moved});
  }
  return poses;
}

std::vector<Edge> chain(const std::vector<SE3>& odometry) {
  std::vector<Edge> edges;
  for (std::size_t i = 0; i + 1 < odometry.size(); ++i) {
    edges.push_back({.from = i,
                     .to = i + 1,
                     .T_from_to = odometry[i].inverse() * odometry[i + 1],
                     .sigmas = {.heading_rad = 0.002, .horizontal_m = 0.004, .vertical_m = 0.001}});
  }
  return edges;
}

Edge loop(const std::vector<SE3>& truth, std::size_t from, std::size_t to) {
  return {.from = from,
          .to = to,
          .T_from_to = truth[from].inverse() * truth[to],
          .sigmas = {.heading_rad = 0.001, .horizontal_m = 0.007, .vertical_m = 0.007},
          .is_loop = true};
}

double worst(const std::vector<SE3>& truth, const std::vector<SE3>& odometry,
             const std::vector<DriftCorrection>& corrections) {
  double most = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Eigen::Vector3d place = corrections[i].transform() * odometry[i].translation;
    most = std::max(most, (place - truth[i].translation).norm());
  }
  return most;
}

TEST(PoseGraph, OneLoopCorrectsHeadingDrift) {
  const std::vector<SE3> truth = circle();
  const std::vector<SE3> odometry = drifted(truth, 0.001, Eigen::Vector3d::Zero());
  std::vector<DriftCorrection> corrections(kPoses);
  const double before = worst(truth, odometry, corrections);
  ASSERT_GT(before, 0.3);
  PoseGraph graph{odometry, chain(odometry)};
  graph.edges.push_back(loop(truth, 3, 75));
  optimize(graph, corrections);
  EXPECT_LT(worst(truth, odometry, corrections), 0.1 * before);
  EXPECT_NEAR(corrections[75].heading, -0.072, 0.005);
  EXPECT_LT(residual_norm(graph, corrections, graph.edges.back()), 1.0);
}

TEST(PoseGraph, ConsistentLoopOrNoLoopChangesNothing) {
  const std::vector<SE3> truth = circle();
  std::vector<DriftCorrection> corrections(kPoses);
  PoseGraph graph{truth, chain(truth)};
  optimize(graph, corrections);
  graph.edges.push_back(loop(truth, 0, 72));
  optimize(graph, corrections);
  EXPECT_LT(worst(truth, truth, corrections), 1e-6);
  EXPECT_NEAR(residual_norm(graph, corrections, graph.edges.back()), 0.0, 1e-6);
}

TEST(PoseGraph, FirstPoseIsFixed) {
  const std::vector<SE3> truth = circle();
  const std::vector<SE3> odometry = drifted(truth, 0.001, {0.002, 0.0, 0.0});
  std::vector<DriftCorrection> corrections(kPoses);
  PoseGraph graph{odometry, chain(odometry)};
  graph.edges.push_back(loop(truth, 3, 75));
  optimize(graph, corrections);
  EXPECT_NEAR(corrections[0].heading, 0.0, 1e-12);
  EXPECT_LT((corrections[0].transform() * odometry[0].translation - truth[0].translation).norm(),
            1e-9);
}

TEST(PoseGraph, RobustLossRejectsOneWrongLoopOfSeven) {
  const std::vector<SE3> truth = circle();
  const std::vector<SE3> odometry = drifted(truth, 0.001, Eigen::Vector3d::Zero());
  std::vector<DriftCorrection> corrections(kPoses);
  PoseGraph graph{odometry, chain(odometry)};
  for (std::size_t k = 0; k < 6; ++k) graph.edges.push_back(loop(truth, k, 72 + k));
  Edge wrong = loop(truth, 2, 76);
  wrong.T_from_to.translation += Eigen::Vector3d(0.6, -0.4, 0.0);
  graph.edges.push_back(wrong);
  optimize(graph, corrections);
  EXPECT_LT(worst(truth, odometry, corrections), 0.05);
}

/// `count` edges of one meter along x, each with the sigmas of `step`.
PoseGraph straight_line(std::size_t count, const EdgeSigmas& step) {
  PoseGraph graph;
  for (std::size_t i = 0; i <= count; ++i) {
    graph.odometry.push_back({Eigen::Quaterniond::Identity(), {static_cast<double>(i), 0.0, 0.0}});
    if (i == 0) continue;
    graph.edges.push_back({.from = i - 1,
                           .to = i,
                           .T_from_to = {Eigen::Quaterniond::Identity(), {1.0, 0.0, 0.0}},
                           .sigmas = step});
  }
  return graph;
}

constexpr EdgeSigmas kStep{.heading_rad = 0.01, .horizontal_m = 0.02, .vertical_m = 0.03};
constexpr EdgeSigmas kSeen{.heading_rad = 0.02, .horizontal_m = 0.05, .vertical_m = 0.05};

Edge seen(std::size_t from, std::size_t to, const Eigen::Vector3d& offset, double turn = 0.0) {
  const Eigen::Vector3d step{static_cast<double>(to) - static_cast<double>(from), 0.0, 0.0};
  return {.from = from,
          .to = to,
          .T_from_to = {so3::exp({0.0, 0.0, turn}), step + offset},
          .sigmas = kSeen,
          .is_loop = true};
}

double distance_of(const PoseGraph& graph, const Edge& edge) {
  return LinearGraph(graph, std::vector<DriftCorrection>(graph.odometry.size()))
      .check(edge)
      .squared_distance;
}

// The variances of n steps add up; a heading error at one step moves all later positions.
TEST(PoseGraph, DistanceOfAnEdgeIsThatOfTheClosedForm) {
  constexpr std::size_t kCount = 9;
  const PoseGraph graph = straight_line(kCount, kStep);
  const double n = kCount;
  const double up = n * kStep.vertical_m * kStep.vertical_m + kSeen.vertical_m * kSeen.vertical_m;
  EXPECT_NEAR(distance_of(graph, seen(0, kCount, {0.0, 0.0, 0.3})), 0.09 / up, 1e-9);
  const double along =
      n * kStep.horizontal_m * kStep.horizontal_m + kSeen.horizontal_m * kSeen.horizontal_m;
  EXPECT_NEAR(distance_of(graph, seen(kCount, 0, {0.2, 0.0, 0.0})), 0.04 / along, 1e-9);
  // Across the path: position (sum of k) and heading, correlated.
  double sum = 0.0;
  double squares = 0.0;
  for (std::size_t k = 0; k < kCount; ++k) {
    sum += static_cast<double>(k);
    squares += static_cast<double>(k * k);
  }
  const double s = kStep.heading_rad * kStep.heading_rad;
  Eigen::Matrix2d covariance;
  covariance << along + squares * s, sum * s, sum * s,
      n * s + kSeen.heading_rad * kSeen.heading_rad;
  const Eigen::Vector2d error(0.1, 0.04);
  EXPECT_NEAR(distance_of(graph, seen(0, kCount, {0.0, 0.1, 0.0}, 0.04)),
              error.dot(covariance.inverse() * error), 1e-9);
}

TEST(PoseGraph, AMeasuredHeightBoundsTheVerticalUncertainty) {
  constexpr std::size_t kCount = 9;
  PoseGraph graph = straight_line(kCount, kStep);
  graph.heights = {{kCount, 0.01}};
  const double chain = kCount * kStep.vertical_m * kStep.vertical_m;
  const double up = 1.0 / (1.0 / chain + 1.0 / 1e-4) + kSeen.vertical_m * kSeen.vertical_m;
  EXPECT_NEAR(distance_of(graph, seen(0, kCount, {0.0, 0.0, 0.3})), 0.09 / up, 1e-9);
}

// By the Kalman filter: the measurement moves the chain's end by var / (var + loop's) of the error.
TEST(PoseGraph, NewsOfAnEdgeIsTheChangeThatItMakes) {
  constexpr std::size_t kCount = 9;
  const PoseGraph graph = straight_line(kCount, kStep);
  const LinearGraph linear(graph, std::vector<DriftCorrection>(kCount + 1));
  const double chain = kCount * kStep.vertical_m * kStep.vertical_m;
  const double loop_variance = kSeen.vertical_m * kSeen.vertical_m;
  const double moved = 0.3 * chain / (chain + loop_variance);
  EXPECT_NEAR(linear.check(seen(0, kCount, {0.0, 0.0, 0.3})).news, moved * moved / loop_variance,
              1e-9);
  EXPECT_NEAR(linear.check(seen(0, kCount, {0.0, 0.0, 0.0})).news, 0.0, 1e-12);
}

TEST(PoseGraph, AKnownLoopMakesTheNextOneMorePrecise) {
  constexpr std::size_t kCount = 9;
  PoseGraph graph = straight_line(kCount, kStep);
  const Edge wrong = seen(0, kCount, {0.0, 0.0, 0.3});
  const double before = distance_of(graph, wrong);
  graph.edges.push_back(seen(0, kCount, {0.0, 0.0, 0.0}));
  const double chain = kCount * kStep.vertical_m * kStep.vertical_m;
  const double loop_variance = kSeen.vertical_m * kSeen.vertical_m;
  const double up = 1.0 / (1.0 / chain + 1.0 / loop_variance) + loop_variance;
  EXPECT_NEAR(distance_of(graph, wrong), 0.09 / up, 1e-9);
  EXPECT_GT(0.09 / up, 1.5 * before);
}

TEST(PoseGraph, HeightHoldsAgainstALoop) {
  constexpr std::size_t kCount = 9;
  PoseGraph graph = straight_line(kCount, kStep);
  graph.edges.push_back(seen(0, kCount, {0.0, 0.0, 0.1}));
  std::vector<DriftCorrection> free(kCount + 1);
  optimize(graph, free);
  EXPECT_GT(free.back().translation.z(), 0.05);
  graph.heights = {{kCount, 0.001}};
  std::vector<DriftCorrection> held(kCount + 1);
  optimize(graph, held);
  EXPECT_LT(held.back().translation.z(), 0.001);
}

}  // namespace
}  // namespace apvi::loop_closure
