// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/se3.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using std::numbers::pi;
using test::MatrixNear;
using test::PoseNear;

std::vector<SE3> edge_case_poses() {
  std::vector<SE3> poses = {SE3::identity()};
  for (const double angle : {1e-12, 1e-5, 1.0, pi - 1e-9, pi}) {
    for (const double distance : {0.0, 1e-9, 1.0, 1e6}) {
      poses.push_back({so3::exp(angle * Vector3d(2, -1, 0.5).normalized()),
                       distance * Vector3d(-1, 3, 2).normalized()});
    }
  }
  return poses;
}

TEST(Se3, InverseTimesTransformIsIdentity) {
  for (const SE3& T : edge_case_poses()) {
    const double scale = 1e-14 * (1.0 + T.translation.norm());
    EXPECT_THAT(T * T.inverse(), PoseNear(SE3::identity(), 10.0 * scale));
    EXPECT_THAT(T.inverse() * T, PoseNear(SE3::identity(), 10.0 * scale));
  }
}

TEST(Se3, CompositionIsAssociative) {
  const auto poses = edge_case_poses();
  for (const SE3& a : poses) {
    for (const SE3& b : poses) {
      const SE3& c = poses[7];
      const double scale = 1.0 + a.translation.norm() + b.translation.norm();
      EXPECT_THAT((a * b) * c, PoseNear(a * (b * c), 1e-14 * scale));
    }
  }
}

TEST(Se3, CompositionMatchesPointTransformAndMatrices) {
  const Vector3d p(0.3, -4.0, 2.0);
  for (const SE3& a : edge_case_poses()) {
    for (const SE3& b : edge_case_poses()) {
      const double tolerance = 1e-14 * (10.0 + a.translation.norm() + b.translation.norm());
      EXPECT_THAT(Vector3d((a * b) * p), MatrixNear(a * (b * p), tolerance));
      EXPECT_THAT((a * b).matrix(), MatrixNear(a.matrix() * b.matrix(), tolerance));
    }
  }
}

TEST(Se3, LongProductsKeepUnitQuaternions) {
  SE3 T;
  const SE3 step{so3::exp(Vector3d(0.01, -0.02, 0.03)), Vector3d(0.1, 0.0, 0.0)};
  for (int i = 0; i < 100000; ++i) T = T * step;
  EXPECT_NEAR(T.rotation.norm(), 1.0, 1e-15);
}

TEST(Se3, InterpolationMatchesEndsAndTakesShortestPath) {
  const SE3 a{so3::exp(Vector3d(0.0, 0.0, 3.0)), Vector3d(1.0, 2.0, 3.0)};
  const SE3 b{so3::exp(Vector3d(0.0, 0.0, -3.0)), Vector3d(3.0, 2.0, 1.0)};
  EXPECT_THAT(interpolate(a, b, 0.0), PoseNear(a, 1e-14));
  EXPECT_THAT(interpolate(a, b, 1.0), PoseNear(b, 1e-14));
  const SE3 middle{so3::exp(Vector3d(0.0, 0.0, pi)), Vector3d(2.0, 2.0, 2.0)};
  EXPECT_THAT(interpolate(a, b, 0.5), PoseNear(middle, 1e-14));
}

TEST(Se3, InterpolatedRotationHasConstantRate) {
  const Vector3d phi(0.4, -0.2, 0.9);
  const SE3 a{so3::exp(Vector3d(1.0, 0.0, 0.0)), Vector3d::Zero()};
  const SE3 b{a.rotation * so3::exp(phi), Vector3d::Zero()};
  for (const double u : {0.1, 0.25, 0.8}) {
    EXPECT_THAT(interpolate(a, b, u).rotation,
                test::RotationNear(a.rotation * so3::exp(u * phi), 1e-14));
  }
}

}  // namespace
}  // namespace apvi
