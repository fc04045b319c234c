// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/umeyama.hpp"

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;
using test::MatrixNear;
using test::PoseNear;

Points random_points(std::size_t count, std::uint64_t seed) {
  Random random(seed);
  Points points(count);
  for (Vector3d& p : points) p = Vector3d(random.normal(), random.normal(), random.normal());
  return points;
}

Points transformed(const SE3& T, const Points& points) {
  Points out;
  for (const Vector3d& p : points) out.push_back(T * p);
  return out;
}

double squared_error(const SE3& T, const Points& source, const Points& target) {
  double sum = 0.0;
  for (std::size_t i = 0; i < source.size(); ++i) sum += (target[i] - T * source[i]).squaredNorm();
  return sum;
}

TEST(Umeyama, RecoversKnownTransform) {
  const SE3 truth{so3::exp(Vector3d(0.5, -2.0, 1.0)), Vector3d(10.0, -3.0, 2.0)};
  const Points source = random_points(20, 1);
  const auto found = align_rigid(source, transformed(truth, source));
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found, PoseNear(truth, 1e-13));
}

TEST(Umeyama, IsAccurateFarFromOrigin) {
  const SE3 truth{so3::exp(Vector3d(0.0, 0.3, 1.0)), Vector3d(5e5, 4e6, -30.0)};
  const Points source = random_points(20, 2);
  const Points target = transformed(truth, source);
  const auto found = align_rigid(source, target);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(squared_error(*found, source, target), 1e-16);
}

TEST(Umeyama, IsLocallyOptimal) {
  const Points source = random_points(30, 3);
  const Points target = random_points(30, 4);
  const auto best = align_rigid(source, target);
  ASSERT_TRUE(best.has_value());
  const double min_error = squared_error(*best, source, target);
  for (const double step : {1e-3, -1e-3}) {
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d delta = step * Vector3d::Unit(axis);
      EXPECT_GT(squared_error(SE3{so3::exp(delta), Vector3d::Zero()} * *best, source, target),
                min_error);
      EXPECT_GT(squared_error(SE3{{1, 0, 0, 0}, delta} * *best, source, target), min_error);
    }
  }
}

TEST(Umeyama, ReturnsRotationForMirroredPoints) {
  const Points source = random_points(20, 5);
  Points target = source;
  for (Vector3d& p : target) p.x() = -p.x();
  const auto found = align_rigid(source, target);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->rotation.norm(), 1.0, 1e-14);
  EXPECT_GT(squared_error(*found, source, target), 1.0);
}

TEST(Umeyama, AlignsPlanarPoints) {
  Points source = random_points(10, 6);
  for (Vector3d& p : source) p.z() = 0.0;
  const SE3 truth{so3::exp(Vector3d(0.2, 0.1, -1.0)), Vector3d(1.0, 2.0, 3.0)};
  const auto found = align_rigid(source, transformed(truth, source));
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found, PoseNear(truth, 1e-13));
}

TEST(Umeyama, RejectsDegeneratePoints) {
  const Points line = {{0, 0, 0}, {1, 2, 3}, {2, 4, 6}, {-1, -2, -3}};
  const Points spread = random_points(4, 7);
  const Points coincident(4, Vector3d(1, 1, 1));
  EXPECT_FALSE(align_rigid(line, spread));
  EXPECT_FALSE(align_rigid(spread, line));
  EXPECT_FALSE(align_rigid(coincident, spread));
  EXPECT_FALSE(align_rigid(Points{{0, 0, 0}, {1, 0, 0}}, Points{{0, 0, 0}, {1, 0, 0}}));
  EXPECT_FALSE(align_rigid(Points{}, Points{}));
}

TEST(YawAlignment, RecoversHeadingAndOffset) {
  const SE3 truth{so3::exp(Vector3d(0.0, 0.0, 2.9)), Vector3d(-4.0, 2.0, 7.0)};
  const Points source = random_points(10, 8);
  const auto found = align_yaw(source, transformed(truth, source));
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found, PoseNear(truth, 1e-13));
}

TEST(YawAlignment, AcceptsTwoPoints) {
  const SE3 truth{so3::exp(Vector3d(0.0, 0.0, -1.0)), Vector3d(1.0, 0.0, 0.0)};
  const Points source = {{0, 0, 0}, {2, 1, 5}};
  const auto found = align_yaw(source, transformed(truth, source));
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found, PoseNear(truth, 1e-13));
}

TEST(YawAlignment, PreservesVertical) {
  const auto found = align_yaw(random_points(20, 9), random_points(20, 10));
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(Vector3d(found->rotation * Vector3d::UnitZ()), MatrixNear(Vector3d::UnitZ(), 1e-15));
}

TEST(YawAlignment, RejectsVerticallyAlignedPoints) {
  const Points vertical = {{1, 1, 0}, {1, 1, 5}, {1, 1, 9}};
  EXPECT_FALSE(align_yaw(vertical, random_points(3, 11)));
  EXPECT_FALSE(align_yaw(Points{{0, 0, 0}}, Points{{1, 0, 0}}));
  EXPECT_FALSE(align_yaw(Points{}, Points{}));
}

TEST(Umeyama, FindsTheScaleOfASimilarity) {
  const std::vector<Vector3d> source = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {1, 1, 3}};
  std::vector<Vector3d> target;
  const Eigen::Quaterniond R = Eigen::Quaterniond::UnitRandom();
  for (const Vector3d& p : source) target.push_back(R * (2.5 * p) + Vector3d(1, 2, 3));
  const auto scale = similarity_scale(source, target);
  ASSERT_TRUE(scale);
  EXPECT_NEAR(*scale, 2.5, 1e-12);
}

TEST(Umeyama, PointsOnALineHaveNoScale) {
  const std::vector<Vector3d> line = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  EXPECT_FALSE(similarity_scale(line, line));
}

}  // namespace
}  // namespace apvi
