// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/merge_sessions.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "floor_dive.hpp"

namespace apvi::loop_closure {
namespace {

/// What odometry adds to every step.
struct Drift {
  double along_m = 0.0;
  double heading = 0.0;
};

/// A session over the floor, and its true path.
struct Survey {
  Session session;
  Path truth;
};

// In a frame of its own; the errors of odometry add up, and the places have them too.
Survey survey(const Path& path, const SE3& T_session_floor, const Drift& drift = {},
              const Look& look = render_floor) {
  CloserOptions options = closer_options(SmoothingOptions{});
  options.places.max_features = 300;
  LoopCloser closer(options, floor_camera());
  SE3 odometry = T_session_floor * path.front();
  for (std::size_t k = 0; k < path.size(); ++k) {
    if (k > 0) {
      SE3 step = path[k - 1].inverse() * path[k];
      step.translation.x() += drift.along_m;
      odometry = odometry * step;
      odometry.rotation = so3::exp({0.0, 0.0, drift.heading}) * odometry.rotation;
    }
    Keyframe keyframe;
    keyframe.stamp = Stamp{} + Duration::from_seconds(static_cast<double>(k));
    keyframe.T_world_camera = odometry;
    keyframe.drift = {.heading = 1e-6, .horizontal = 1e-3, .vertical = 1e-7};
    closer.add(keyframe, look(path[k]));
  }
  closer.flush();
  Survey made{.session = {.places = closer.place_map(), .trajectory = {}, .camera = floor_camera()},
              .truth = path};
  for (std::size_t k = 0; k < closer.graph().size(); ++k) {
    made.session.trajectory.poses.push_back(
        {closer.graph()[k].stamp, closer.graph().corrected_pose(k)});
  }
  made.session.drift_per_s = {.heading = 2e-5, .horizontal = 1e-3, .vertical = 1e-6};
  return made;
}

std::vector<MergedSession> merged(const std::vector<Survey>& surveys) {
  std::vector<Session> sessions;
  for (const Survey& survey : surveys) sessions.push_back(survey.session);
  return merge_sessions(sessions);
}

/// Largest errors of the poses of a session in the frame of the floor.
struct Error {
  double position_m = 0.0;
  double heading = 0.0;
};

Error error_of(const Survey& survey, const MergedSession& merged, const SE3& T_floor_joint) {
  const Trajectory corrected = merged.path.corrected(survey.session.trajectory);
  Error largest;
  for (std::size_t k = 0; k < survey.truth.size(); ++k) {
    const SE3 pose = T_floor_joint * corrected.poses[k].T_world_body;
    const SE3& truth = survey.truth[k];
    largest.position_m =
        std::max(largest.position_m, (pose.translation - truth.translation).norm());
    largest.heading =
        std::max(largest.heading, std::abs(so3::yaw(pose.rotation * truth.rotation.conjugate())));
  }
  return largest;
}

const SE3 kFirstFloor{so3::exp({0.0, 0.0, -0.4}), {3.0, 1.0, -0.2}};
const SE3 kLaterFloor{so3::exp({0.0, 0.0, 2.6}), {-7.0, 4.0, 0.3}};

const Survey& first_survey() {
  static const Survey made =
      survey(joined(line(-3.5, 3.5, 0.0), line(-3.5, 3.5, 1.2)), kFirstFloor);
  return made;
}

TEST(MergeSessions, FindsAnotherSessionAtAnyHeadingAndPosition) {
  const std::vector<Survey> surveys = {first_survey(),
                                       survey(line(-3.0, 3.0, 0.5, 1.1), kLaterFloor)};
  const auto result = merged(surveys);
  ASSERT_TRUE(result[1].found);
  EXPECT_GT(result[1].edges, 8U);
  EXPECT_EQ(result[1].rejected, 0U);
  const Error error = error_of(surveys[1], result[1], kFirstFloor.inverse());
  EXPECT_LT(error.position_m, 0.03);
  EXPECT_LT(error.heading, 0.3 * kRadiansPerDegree);
}

TEST(MergeSessions, DriftOfALaterSessionIsRemoved) {
  const Drift drift{.along_m = 0.003, .heading = 0.004};  // 1 % of the way, 4 degrees
  const std::vector<Survey> surveys = {first_survey(),
                                       survey(line(-3.0, 3.0, 0.5, 0.1), kLaterFloor, drift)};
  const Trajectory& before = surveys[1].session.trajectory;
  const SE3 end = kLaterFloor.inverse() * before.poses.back().T_world_body;
  ASSERT_GT((end.translation - surveys[1].truth.back().translation).norm(), 0.2);
  const auto result = merged(surveys);
  ASSERT_TRUE(result[1].found);
  EXPECT_LT(error_of(surveys[1], result[1], kFirstFloor.inverse()).position_m, 0.02);
  EXPECT_LT(result[1].rms_m, 0.5 * result[1].rms_placed_m);
}

TEST(MergeSessions, DriftOfTheFirstSessionIsRemovedByALaterOneWithoutAny) {
  const Drift drift{.along_m = 0.012, .heading = 0.0};
  Survey first = survey(line(-3.5, 3.5, 0.0), kFirstFloor, drift);
  Survey later = survey(line(-3.5, 3.5, 0.3), kLaterFloor);
  later.session.drift_per_s = {.heading = 1e-10, .horizontal = 1e-8, .vertical = 1e-10};
  const auto result = merged({first, later});
  ASSERT_TRUE(result[1].found);
  EXPECT_LT(error_of(first, result[0], kFirstFloor.inverse()).position_m, 0.06);
  EXPECT_EQ(result[0].path.corrections().front().translation.norm(), 0.0);
}

TEST(MergeSessions, ASessionElsewhereIsNotFound) {
  const std::vector<Survey> surveys = {first_survey(), survey(line(-3.5, 3.5, 6.0), kLaterFloor)};
  const auto result = merged(surveys);
  EXPECT_TRUE(result[0].found);
  EXPECT_FALSE(result[1].found);
  EXPECT_EQ(result[1].edges, 0U);
  EXPECT_EQ(result[1].path.corrections().front().heading, 0.0);
}

// The second one sees the third one only, which sees the first one.
TEST(MergeSessions, ASessionIsFoundByWayOfALaterOne) {
  const std::vector<Survey> surveys = {
      survey(line(-3.0, 3.0, 0.0), kFirstFloor), survey(line(-3.0, 3.0, 3.6), kLaterFloor),
      survey(joined(line(-3.0, 3.0, 0.3), line(-3.0, 3.0, 3.3)), SE3::identity())};
  const auto result = merged(surveys);
  ASSERT_TRUE(result[2].found);
  ASSERT_TRUE(result[1].found);
  EXPECT_LT(error_of(surveys[1], result[1], kFirstFloor.inverse()).position_m, 0.06);
}

TEST(MergeSessions, ASessionWithoutPlacesIsNotFound) {
  Survey empty = survey(line(-3.0, 3.0, 0.5), kLaterFloor);
  empty.session.places.places.clear();
  EXPECT_FALSE(merged({first_survey(), empty})[1].found);
  EXPECT_FALSE(merged({empty, first_survey()})[1].found);
}

TEST(MergeSessions, ASessionWithoutATrajectoryIsAnError) {
  Survey empty = first_survey();
  empty.session.trajectory.poses.clear();
  EXPECT_THROW(merged({empty}), InputError);
}

TEST(SessionPath, CorrectionsAreInterpolatedBetweenNodes) {
  Trajectory trajectory;
  for (int k = 0; k <= 10; ++k) {
    trajectory.poses.push_back({Stamp{} + Duration::from_seconds(0.5 * k), SE3::identity()});
  }
  SessionPath path(trajectory, 2.0, 100);
  ASSERT_EQ(path.size(), 4U) << "at 0, 2, 4 and 5 s";
  path.corrections()[1].translation.x() = 1.0;
  const auto x_at = [&](double s) {
    return path.correction(Stamp{} + Duration::from_seconds(s)).translation.x();
  };
  EXPECT_NEAR(x_at(1.5), 0.75, 1e-12);
  EXPECT_NEAR(x_at(3.0), 0.5, 1e-12);
  EXPECT_EQ(x_at(9.0), 0.0);
  EXPECT_EQ(path.node_at(Stamp{} + Duration::from_seconds(2.9)), 1U);
  EXPECT_EQ(path.node_at(Stamp{} + Duration::from_seconds(99.0)), 3U);
  EXPECT_NEAR(path.corrected(trajectory).poses[3].T_world_body.translation.x(), 0.75, 1e-12);
}

TEST(SessionPath, HasNoMoreNodesThanAllowed) {
  Trajectory trajectory;
  for (int k = 0; k <= 1000; ++k) {
    trajectory.poses.push_back({Stamp{} + Duration::from_seconds(0.1 * k), SE3::identity()});
  }
  EXPECT_LE(SessionPath(trajectory, 0.5, 20).size(), 21U);
}

TEST(OwnEdges, ContainTheLoopsOfTheSession) {
  const Survey made = survey(joined(line(-3.5, 3.5, 0.0), line(-3.5, 3.5, 0.2)), kFirstFloor);
  const SessionPath path(made.session.trajectory, 2.0, 100);
  const std::vector<Edge> edges = own_edges(made.session, path, 16.25);
  const auto loops = std::ranges::count_if(edges, &Edge::is_loop);
  EXPECT_GT(loops, 5);
  for (const Edge& edge : edges) {
    const SE3 expected = path.pose(edge.from).inverse() * path.pose(edge.to);
    EXPECT_LT((expected.translation - edge.T_from_to.translation).norm(), 0.03);
  }
}

}  // namespace
}  // namespace apvi::loop_closure
