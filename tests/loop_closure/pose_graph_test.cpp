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
  std::vector<Edge> edges = chain(odometry);
  edges.push_back(loop(truth, 3, 75));
  optimize_pose_graph(odometry, edges, corrections);
  EXPECT_LT(worst(truth, odometry, corrections), 0.1 * before);
  EXPECT_NEAR(corrections[75].heading, -0.072, 0.005);
  EXPECT_LT(residual_norm(edges.back(), odometry, corrections), 1.0);
}

TEST(PoseGraph, ConsistentLoopOrNoLoopChangesNothing) {
  const std::vector<SE3> truth = circle();
  std::vector<DriftCorrection> corrections(kPoses);
  std::vector<Edge> edges = chain(truth);
  optimize_pose_graph(truth, edges, corrections);
  edges.push_back(loop(truth, 0, 72));
  optimize_pose_graph(truth, edges, corrections);
  EXPECT_LT(worst(truth, truth, corrections), 1e-6);
  EXPECT_NEAR(residual_norm(edges.back(), truth, corrections), 0.0, 1e-6);
}

TEST(PoseGraph, FirstPoseIsFixed) {
  const std::vector<SE3> truth = circle();
  const std::vector<SE3> odometry = drifted(truth, 0.001, {0.002, 0.0, 0.0});
  std::vector<DriftCorrection> corrections(kPoses);
  std::vector<Edge> edges = chain(odometry);
  edges.push_back(loop(truth, 3, 75));
  optimize_pose_graph(odometry, edges, corrections);
  EXPECT_NEAR(corrections[0].heading, 0.0, 1e-12);
  EXPECT_LT((corrections[0].transform() * odometry[0].translation - truth[0].translation).norm(),
            1e-9);
}

TEST(PoseGraph, RobustLossRejectsOneWrongLoopOfSeven) {
  const std::vector<SE3> truth = circle();
  const std::vector<SE3> odometry = drifted(truth, 0.001, Eigen::Vector3d::Zero());
  std::vector<DriftCorrection> corrections(kPoses);
  std::vector<Edge> edges = chain(odometry);
  for (std::size_t k = 0; k < 6; ++k) edges.push_back(loop(truth, k, 72 + k));
  Edge wrong = loop(truth, 2, 76);
  wrong.T_from_to.translation += Eigen::Vector3d(0.6, -0.4, 0.0);
  edges.push_back(wrong);
  optimize_pose_graph(odometry, edges, corrections);
  EXPECT_LT(worst(truth, odometry, corrections), 0.05);
}

}  // namespace
}  // namespace apvi::loop_closure
