// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/two_view.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"

namespace apvi::vio {
namespace {

using Eigen::Vector3d;

const SE3 kMotion{so3::exp({0.02, -0.05, 0.03}), Vector3d(0.3, -0.1, 0.2).normalized()};

// Pairs of points in the first camera, seen before and after the motion.
std::vector<PointPair> pairs_of(const std::function<Vector3d(Random&)>& point, double noise) {
  Random random(3);
  std::vector<PointPair> pairs;
  while (pairs.size() < 100) {
    const Vector3d p = point(random);
    const Vector3d q = kMotion.inverse() * p;
    PointPair pair{p.head<2>() / p.z(), q.head<2>() / q.z()};
    for (Eigen::Vector2d* end : {&pair.before, &pair.now}) {
      *end += Eigen::Vector2d(random.normal(0.0, noise), random.normal(0.0, noise));
    }
    pairs.push_back(pair);
  }
  return pairs;
}

Vector3d in_a_volume(Random& random) {
  return {random.uniform(-4.0, 4.0), random.uniform(-3.0, 3.0), random.uniform(6.0, 14.0)};
}

Vector3d on_a_plane(Random& random) {
  const Vector3d p = in_a_volume(random);
  return {p.x(), p.y(), 8.0 + 0.3 * p.x() - 0.2 * p.y()};
}

double direction_error(const SE3& motion) {
  return std::acos(std::clamp(motion.translation.dot(kMotion.translation), -1.0, 1.0));
}

bool contains_the_motion(const std::vector<SE3>& motions) {
  return std::ranges::any_of(motions, [](const SE3& motion) {
    return direction_error(motion) < 0.02 &&
           so3::angle_between(motion.rotation, kMotion.rotation) < 0.005;
  });
}

TEST(TwoView, FindsTheMotionOverAVolume) {
  EXPECT_TRUE(contains_the_motion(possible_motions(pairs_of(in_a_volume, 1e-5), 2e-3)));
}

TEST(TwoView, FindsTheMotionOverAPlane) {
  EXPECT_TRUE(contains_the_motion(possible_motions(pairs_of(on_a_plane, 1e-5), 2e-3)));
}

TEST(TwoView, MotionsHaveATranslationOfLengthOne) {
  for (const SE3& motion : possible_motions(pairs_of(on_a_plane, 1e-4), 2e-3)) {
    EXPECT_NEAR(motion.translation.norm(), 1.0, 1e-9);
  }
}

TEST(TwoView, FindsNoMotionInPairsThatDoNotMatch) {
  Random random(5);
  std::vector<PointPair> pairs = pairs_of(in_a_volume, 0.0);
  pairs.resize(3);
  EXPECT_TRUE(possible_motions(pairs, 1e-3).empty());
}

TEST(TwoView, TriangulatesTheDepthInBaselines) {
  const Vector3d p(1.0, -0.5, 9.0);
  const Vector3d q = kMotion.inverse() * p;
  const auto point = triangulate({p.head<2>() / p.z(), q.head<2>() / q.z()}, kMotion);
  ASSERT_TRUE(point);
  EXPECT_NEAR(point->depth, 9.0, 1e-9);
  const double angle = std::acos(p.normalized().dot((p - kMotion.translation).normalized()));
  EXPECT_NEAR(point->parallax, angle, 1e-9);
}

TEST(TwoView, RejectsAPointBehindTheCameras) {
  const Vector3d p(1.0, -0.5, -9.0);
  const Vector3d q = kMotion.inverse() * p;
  EXPECT_FALSE(triangulate({p.head<2>() / p.z(), q.head<2>() / q.z()}, kMotion));
}

}  // namespace
}  // namespace apvi::vio
