// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/so3.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "support/matchers.hpp"
#include "support/numeric_jacobian.hpp"

namespace apvi {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using std::numbers::pi;
using test::MatrixNear;
using test::RotationNear;

// Numerically critical angles: near zero, near the switch to the series, near pi.
std::vector<Vector3d> edge_case_vectors(double largest) {
  const std::vector<Vector3d> axes = {Vector3d::UnitX(), -Vector3d::UnitY(), Vector3d::UnitZ(),
                                      Vector3d(1, 2, 3).normalized(),
                                      Vector3d(-0.3, 1e-9, 0.7).normalized()};
  std::vector<Vector3d> vectors = {Vector3d::Zero()};
  for (const double angle : {1e-300, 1e-12, 1e-8, 0.99e-4, 1.01e-4, 1e-3, 0.99e-2, 1.01e-2, 0.5,
                             pi / 2, 3.0, pi - 1e-3, pi - 1e-7, pi}) {
    if (angle > largest) continue;
    for (const Vector3d& axis : axes) vectors.emplace_back(angle * axis);
  }
  return vectors;
}

TEST(So3, HatIsTheCrossProduct) {
  const Vector3d a(0.3, -1.2, 2.0);
  const Vector3d b(4.0, 0.1, -0.7);
  EXPECT_THAT(Vector3d(so3::hat(a) * b), MatrixNear(a.cross(b), 1e-15));
}

TEST(So3, ExpOfZeroIsExactlyIdentity) {
  EXPECT_EQ(so3::exp(Vector3d::Zero()).coeffs(), Quaterniond::Identity().coeffs());
}

TEST(So3, ExpMatchesAngleAxis) {
  for (const Vector3d& phi : edge_case_vectors(pi)) {
    const double angle = phi.norm();
    if (angle < 1e-200) continue;  // the norm underflows
    const Quaterniond expected(Eigen::AngleAxisd(angle, phi / angle));
    EXPECT_NEAR(so3::exp(phi).norm(), 1.0, 1e-15);
    EXPECT_THAT(so3::exp(phi), RotationNear(expected, 1e-14)) << phi.transpose();
  }
}

TEST(So3, LogInvertsExp) {
  for (const Vector3d& phi : edge_case_vectors(pi - 1e-9)) {
    EXPECT_THAT(so3::log(so3::exp(phi)), MatrixNear(phi, 1e-14 + 1e-15 * phi.norm()))
        << phi.transpose();
  }
}

TEST(So3, LogAtPiHasCorrectAxis) {
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  const Vector3d back = so3::log(so3::exp(pi * axis));
  EXPECT_NEAR(back.norm(), pi, 1e-14);
  EXPECT_NEAR(std::abs(back.normalized().dot(axis)), 1.0, 1e-14);
}

TEST(So3, LogIgnoresQuaternionSign) {
  for (const Vector3d& phi : edge_case_vectors(3.0)) {
    const Quaterniond q = so3::exp(phi);
    EXPECT_EQ(so3::log(Quaterniond(-q.coeffs())), so3::log(q));
  }
}

TEST(So3, LogIsAccurateForTinyRotations) {
  const Vector3d phi(1e-9, -2e-9, 3e-9);
  EXPECT_THAT(so3::log(so3::exp(phi)), MatrixNear(phi, 1e-24));
}

TEST(So3, LogWrapsRotationsBeyondPi) {
  EXPECT_THAT(so3::log(so3::exp(Vector3d(0, 0, 1.5 * pi))),
              MatrixNear(Vector3d(0, 0, -pi / 2), 1e-14));
}

TEST(So3, RightJacobianIsTheDerivativeOfExp) {
  for (const Vector3d& phi : edge_case_vectors(3.2)) {
    const Quaterniond base = so3::exp(phi);
    const Eigen::MatrixXd numeric = test::numeric_jacobian(
        [&](const Vector3d& delta) { return so3::log(base.conjugate() * so3::exp(phi + delta)); },
        3, 1e-5);
    EXPECT_THAT(so3::right_jacobian(phi), MatrixNear(numeric, 1e-9)) << phi.transpose();
  }
}

TEST(So3, RightJacobianInverseInvertsRightJacobian) {
  for (const Vector3d& phi : edge_case_vectors(pi)) {
    EXPECT_THAT(Matrix3d(so3::right_jacobian(phi) * so3::right_jacobian_inverse(phi)),
                MatrixNear(Matrix3d::Identity(), 1e-12))
        << phi.transpose();
  }
}

TEST(So3, AdjointIdentityHolds) {
  const Quaterniond r = so3::exp(Vector3d(0.4, -1.0, 2.0));
  for (const Vector3d& phi : edge_case_vectors(2.0)) {
    EXPECT_THAT(r * so3::exp(phi) * r.conjugate(), RotationNear(so3::exp(r * phi), 1e-14));
  }
}

TEST(So3, NearestRotationCorrectsRounding) {
  const Matrix3d exact = so3::exp(Vector3d(0.3, -0.8, 1.9)).toRotationMatrix();
  const Matrix3d rounded = (1e4 * exact).array().round() / 1e4;  // four digits, as printed in files
  const auto repaired = so3::nearest_rotation(rounded);
  ASSERT_TRUE(repaired.has_value());
  EXPECT_THAT(Matrix3d(*repaired * repaired->transpose()), MatrixNear(Matrix3d::Identity(), 1e-14));
  EXPECT_THAT(*repaired, MatrixNear(exact, 2e-4));
}

TEST(So3, NearestRotationRejectsNonRotations) {
  const Matrix3d reflection = Vector3d(1, 1, -1).asDiagonal();
  EXPECT_FALSE(so3::nearest_rotation(reflection));
  EXPECT_FALSE(so3::nearest_rotation(Matrix3d::Zero()));
  EXPECT_FALSE(so3::nearest_rotation(Matrix3d(1.1 * Matrix3d::Identity())));
  EXPECT_FALSE(so3::nearest_rotation(Matrix3d::Constant(std::nan(""))));
}

TEST(So3, AngleBetweenIsSymmetricAndBoundedByPi) {
  const Quaterniond a = so3::exp(Vector3d(2.0, 2.0, 0.0));
  const Quaterniond b = so3::exp(Vector3d(-1.0, 0.3, 2.5));
  EXPECT_DOUBLE_EQ(so3::angle_between(a, b), so3::angle_between(b, a));
  EXPECT_LE(so3::angle_between(a, b), pi);
  EXPECT_NEAR(so3::angle_between(a, a), 0.0, 1e-15);
}

TEST(So3, YawMatchesZyxAngles) {
  for (const double heading : {-3.0, -1.0, 0.0, 0.7, pi}) {
    const Quaterniond q = Quaterniond(Eigen::AngleAxisd(heading, Vector3d::UnitZ()) *
                                      Eigen::AngleAxisd(0.4, Vector3d::UnitY()) *
                                      Eigen::AngleAxisd(-0.9, Vector3d::UnitX()));
    EXPECT_NEAR(so3::yaw(q), heading, 1e-14);
  }
}

TEST(So3, LevelAttitudeAlignsSpecificForceWithZeroYaw) {
  for (const double sign : {1.0, -1.0}) {  // z up, and north-east-down
    const Vector3d gravity(0.0, 0.0, -9.81 * sign);
    const Quaterniond truth(Eigen::AngleAxisd(0.3, Vector3d::UnitY()) *
                            Eigen::AngleAxisd(-0.5, Vector3d::UnitX()));
    const Vector3d force_body = truth.conjugate() * -gravity;
    EXPECT_THAT(so3::level_attitude(force_body, gravity), RotationNear(truth, 1e-14));
  }
}

TEST(So3, LevelAttitudeHandlesUpsideDownVehicle) {
  const Vector3d gravity(0.0, 0.0, -9.81);
  const Quaterniond q = so3::level_attitude(Vector3d(0.0, 0.0, -9.81), gravity);
  EXPECT_THAT(Vector3d(q * Vector3d(0.0, 0.0, -9.81)), MatrixNear(Vector3d(0.0, 0.0, 9.81), 1e-12));
}

}  // namespace
}  // namespace apvi
