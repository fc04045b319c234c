// SPDX-License-Identifier: BSD-3-Clause
// Tests of the epipolar check: which point pairs agree with one camera motion.
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/spline_imu.hpp"
#include "vio/frontend/epipolar_check.hpp"
#include "vio/frontend/rigidity_check.hpp"

namespace apvi::vio {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kThreshold = 1.0 / 400.0;

struct Scene {
  Quaterniond R_now_before = so3::exp(Vector3d(0.02, -0.05, 0.03));
  Vector3d t_now_before = Vector3d(0.3, -0.1, 0.2);
  std::vector<PointPair> pairs;
  std::size_t good = 0;  // inliers come first; the rest are outliers
};

Scene make_scene(std::size_t good, std::size_t bad, double noise) {
  Scene scene;
  Random random(21);
  while (scene.pairs.size() < good + bad) {
    const Vector3d p(random.uniform(-3.0, 3.0), random.uniform(-2.0, 2.0),
                     random.uniform(3.0, 9.0));
    const Vector3d now = scene.R_now_before * p + scene.t_now_before;
    PointPair pair{p.hnormalized(), now.hnormalized()};
    pair.now += Vector2d(random.normal(0.0, noise), random.normal(0.0, noise));
    if (scene.pairs.size() >= good) {
      pair.now += 0.1 * Vector2d(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0));
    }
    scene.pairs.push_back(pair);
  }
  scene.good = good;
  return scene;
}

void expect_good_kept(const Scene& scene, const CameraMotion& motion) {
  std::size_t kept = 0;
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < scene.pairs.size(); ++i) {
    const bool near = epipolar_distance(motion.essential(), scene.pairs[i]) < kThreshold;
    if (near) ++(i < scene.good ? kept : wrong);
  }
  EXPECT_GT(kept, 0.97 * static_cast<double>(scene.good));
  EXPECT_LT(wrong, 0.15 * static_cast<double>(scene.pairs.size() - scene.good));
}

TEST(Epipolar, ScenePointHasZeroDistance) {
  const Scene scene = make_scene(50, 0, 0.0);
  const auto essential = essential_matrix(scene.R_now_before, scene.t_now_before);
  for (const PointPair& pair : scene.pairs) {
    EXPECT_NEAR(epipolar_distance(essential, pair), 0.0, 1e-12);
  }
}

TEST(Epipolar, DistanceIsTheCorrectionOfBothPoints) {
  Scene scene = make_scene(50, 0, 0.0);
  const auto essential = essential_matrix(scene.R_now_before, scene.t_now_before);
  for (PointPair pair : scene.pairs) {
    const Vector2d line = (essential * pair.before.homogeneous()).head<2>().normalized();
    pair.now += 2e-3 * line;
    const double distance = epipolar_distance(essential, pair);
    EXPECT_GT(distance, 1.0e-3);  // distributed over two points: between half and all of it
    EXPECT_LT(distance, 2.0e-3);
  }
}

TEST(Epipolar, FindsTheMotionWithFortyPercentOutliers) {
  const Scene scene = make_scene(90, 60, 3e-4);
  const auto motion = best_motion(scene.pairs, scene.R_now_before, kThreshold);
  ASSERT_TRUE(motion);
  EXPECT_LT(so3::angle_between(motion->R_now_before, scene.R_now_before), 2e-3);
  const double cosine = std::abs(motion->direction.dot(scene.t_now_before.normalized()));
  EXPECT_GT(cosine, std::cos(0.03));
  expect_good_kept(scene, *motion);
}

TEST(Epipolar, CorrectsAGyroRotationErrorOfAThirdOfADegree) {
  const Scene scene = make_scene(120, 30, 3e-4);
  const Quaterniond off = so3::exp(Vector3d(0.004, -0.003, 0.003)) * scene.R_now_before;
  const auto motion = best_motion(scene.pairs, off, kThreshold);
  ASSERT_TRUE(motion);
  EXPECT_LT(so3::angle_between(motion->R_now_before, scene.R_now_before), 2e-3);
  expect_good_kept(scene, *motion);
}

TEST(Epipolar, FindsTheMotionWithoutGyro) {
  const Scene scene = make_scene(110, 40, 3e-4);
  const auto motion = best_motion(scene.pairs, std::nullopt, kThreshold);
  ASSERT_TRUE(motion);
  EXPECT_LT(so3::angle_between(motion->R_now_before, scene.R_now_before), 5e-3);
  expect_good_kept(scene, *motion);
}

TEST(Epipolar, PureRotationRejectsNothing) {
  Scene scene = make_scene(0, 0, 0.0);
  scene.t_now_before.setZero();
  Random random(22);
  for (int i = 0; i < 100; ++i) {
    const Vector3d p(random.uniform(-3.0, 3.0), random.uniform(-2.0, 2.0), 5.0);
    const Vector2d noise(random.normal(0.0, 2e-4), random.normal(0.0, 2e-4));
    scene.pairs.push_back({p.hnormalized(), (scene.R_now_before * p).hnormalized() + noise});
  }
  for (const bool gyro : {true, false}) {
    const auto motion = best_motion(
        scene.pairs, gyro ? std::optional(scene.R_now_before) : std::nullopt, kThreshold);
    ASSERT_TRUE(motion);
    for (const PointPair& pair : scene.pairs) {
      EXPECT_LT(epipolar_distance(motion->essential(), pair), kThreshold);
    }
  }
}

TEST(Epipolar, ReturnsNulloptWithTooFewPairs) {
  const Scene scene = make_scene(7, 0, 0.0);
  EXPECT_FALSE(best_motion(scene.pairs, scene.R_now_before, kThreshold));
  EXPECT_FALSE(best_motion({}, std::nullopt, kThreshold));
}

// The last of 60 points drifts across its epipolar line by a fifth of the threshold per frame.
std::vector<TrackPoint> creeping(int frame) {
  Random random(23);
  const SE3 T_now_world{Quaterniond::Identity(), Vector3d(0.02 * frame, 0.0, 0.0)};
  std::vector<TrackPoint> points;
  for (int i = 0; i < 60; ++i) {
    const Vector3d p(random.uniform(-3.0, 3.0), random.uniform(-2.0, 2.0),
                     random.uniform(3.0, 9.0));
    points.push_back({i, (T_now_world * p).hnormalized()});
  }
  points.back().point.y() += 0.2 * kThreshold * frame;
  return points;
}

Stamp stamp_of(int frame) {
  return Stamp{50'000'000 * static_cast<std::int64_t>(frame)};
}

TEST(Rigidity, RejectsASlowlyDriftingPointAfterSomeFrames) {
  RigidityCheck check(0.5 * kThreshold);
  std::vector<char> stays;
  for (int frame = 0; frame < 12; ++frame) {
    stays = check.check(stamp_of(frame), creeping(frame), Quaterniond::Identity());
    if (frame == 1) {
      EXPECT_EQ(stays.back(), 1);
    }
    check.add(stamp_of(frame), creeping(frame));
  }
  EXPECT_EQ(stays.back(), 0);
  EXPECT_GE(std::count(stays.begin(), stays.end(), 1), 58);
}

TEST(Rigidity, MatchesTracksById) {
  RigidityCheck check(kThreshold);
  for (int frame = 0; frame < 12; ++frame) {
    auto points = creeping(frame);
    points.pop_back();
    points.erase(points.begin() + frame);
    points.erase(points.begin() + 30);
    const auto stays = check.check(stamp_of(frame), points, Quaterniond::Identity());
    EXPECT_EQ(std::count(stays.begin(), stays.end(), 1), 57);
    check.add(stamp_of(frame), points);
  }
}

}  // namespace
}  // namespace apvi::vio
