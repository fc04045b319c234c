// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "vio/factor_check.hpp"

namespace apvi::vio {
namespace {

using Eigen::VectorXd;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using test::Values;

Vector6 random_tangent(Random& random, double size) {
  Vector6 delta;
  for (double& d : delta) d = random.uniform(-size, size);
  return delta;
}

TEST(PoseManifold, MinusInvertsPlus) {
  Random random(1);
  const PoseManifold manifold;
  for (int i = 0; i < 50; ++i) {
    const PoseBlock x = to_block(test::random_pose(random, 3.0, 10.0));
    const Vector6 delta = random_tangent(random, 1.5);
    PoseBlock y{};
    Vector6 back;
    ASSERT_TRUE(manifold.Plus(x.data(), delta.data(), y.data()));
    ASSERT_TRUE(manifold.Minus(y.data(), x.data(), back.data()));
    EXPECT_TRUE(back.isApprox(delta, 1e-12)) << back.transpose();
  }
}

TEST(PoseManifold, PlusInvertsMinus) {
  Random random(2);
  const PoseManifold manifold;
  for (int i = 0; i < 50; ++i) {
    const PoseBlock x = to_block(test::random_pose(random, 3.0, 10.0));
    const PoseBlock y = to_block(test::random_pose(random, 3.0, 10.0));
    Vector6 delta;
    PoseBlock z{};
    manifold.Minus(y.data(), x.data(), delta.data());
    manifold.Plus(x.data(), delta.data(), z.data());
    const SE3 difference = to_se3(y.data()).inverse() * to_se3(z.data());
    EXPECT_LT(so3::log(difference.rotation).norm(), 1e-12);
    EXPECT_LT(difference.translation.norm(), 1e-12);
  }
}

TEST(PoseManifold, PlusWorksInPlace) {
  Random random(3);
  const PoseManifold manifold;
  PoseBlock x = to_block(test::random_pose(random, 3.0, 10.0));
  const Vector6 delta = random_tangent(random, 1.0);
  PoseBlock elsewhere{};
  manifold.Plus(x.data(), delta.data(), elsewhere.data());
  manifold.Plus(x.data(), delta.data(), x.data());
  EXPECT_EQ(x, elsewhere);
}

TEST(PoseManifold, RotatesInTheBodyFrameAndTranslatesInTheWorldFrame) {
  const SE3 pose{so3::exp({0.0, 0.0, 1.5707963267948966}), {1.0, 2.0, 3.0}};
  const PoseBlock x = to_block(pose);
  Vector6 delta;
  delta << 0.1, 0.0, 0.0, 0.5, 0.0, 0.0;
  PoseBlock y{};
  PoseManifold().Plus(x.data(), delta.data(), y.data());
  const SE3 moved = to_se3(y.data());
  EXPECT_LT(so3::angle_between(moved.rotation, pose.rotation * so3::exp({0.1, 0.0, 0.0})), 1e-12);
  EXPECT_TRUE(moved.translation.isApprox(Eigen::Vector3d(1.5, 2.0, 3.0)));
}

TEST(PoseManifold, KeepsQuaternionsNormalized) {
  Random random(4);
  PoseBlock x{0, 0, 0, 0, 0, 0, 1};
  for (int i = 0; i < 10'000; ++i) {
    const Vector6 delta = random_tangent(random, 0.1);
    PoseManifold().Plus(x.data(), delta.data(), x.data());
  }
  EXPECT_NEAR(Eigen::Map<Eigen::Vector4d>(x.data() + 3).norm(), 1.0, 1e-14);
}

TEST(PoseManifold, JacobiansOfMinusAndPlusAreInverse) {
  Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
  Eigen::Matrix<double, 6, 7, Eigen::RowMajor> minus;
  const PoseBlock x{0, 0, 0, 0, 0, 0, 1};
  PoseManifold().PlusJacobian(x.data(), plus.data());
  PoseManifold().MinusJacobian(x.data(), minus.data());
  EXPECT_TRUE((minus * plus).isIdentity(0.0));
  EXPECT_TRUE(plus.row(6).isZero(0.0));
}

}  // namespace
}  // namespace apvi::vio
