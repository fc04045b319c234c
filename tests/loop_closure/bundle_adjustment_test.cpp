// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/bundle_adjustment.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "bundle_dive.hpp"

namespace apvi::loop_closure {
namespace {

double largest_turn(const std::vector<SE3>& truth, const std::vector<SE3>& poses) {
  double largest = 0.0;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    largest = std::max(largest, so3::angle_between(truth[k].rotation, poses[k].rotation));
  }
  return largest;
}

PathError camera_error(const BundleDive& dive, const BundleResult& result) {
  return path_error(cameras_of(dive.truth, mounting()),
                    cameras_of(result.T_world_body, result.camera.T_body_camera));
}

TEST(BundleAdjustment, ImagesRemoveTheDriftOfOdometry) {
  const BundleDive dive = bundle_dive();
  ASSERT_GT(path_error(dive.truth, start_of(dive)).shape_m, 0.008);
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  const PathError error = camera_error(dive, *result);
  EXPECT_LT(error.shape_m, 0.002);
  EXPECT_NEAR(error.scale, 1.0, 0.005);
  EXPECT_LT(largest_turn(dive.truth, result->T_world_body), 0.15 * kRadiansPerDegree);
  EXPECT_GT(result->rms_before, 3.0 * result->rms_after);
  EXPECT_NEAR(result->rms_after * kFocal, kNoise_px * std::sqrt(2.0), 0.1);
}

TEST(BundleAdjustment, WrongMatchesDoNotMoveThePoses) {
  BundleDive dive = bundle_dive();
  std::mt19937 random(3);
  for (Place& place : dive.places) {  // one feature of ten is described as another one
    std::uniform_int_distribution<int> any(0, place.descriptors.rows - 1);
    for (int i = 0; i < place.descriptors.rows; i += 10) {
      place.descriptors.row(any(random)).copyTo(place.descriptors.row(i));
    }
  }
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  EXPECT_LT(camera_error(dive, *result).shape_m, 0.003);
}

TEST(BundleAdjustment, AWrongFocalLengthIsFound) {
  const BundleDive dive = bundle_dive(1.01);
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  EXPECT_NEAR(result->camera.lens.scale, 1.01, 0.003);
  EXPECT_LT(camera_error(dive, *result).shape_m, 0.003);
}

TEST(BundleAdjustment, AWrongMountingIsFound) {
  const SE3 error{so3::exp({0.0, 0.0, 1.0 * kRadiansPerDegree}), Eigen::Vector3d::Zero()};
  const BundleDive dive = bundle_dive(1.0, error);
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  EXPECT_LT(so3::angle_between(result->camera.T_body_camera.rotation, mounting().rotation),
            0.15 * kRadiansPerDegree);
}

TEST(BundleAdjustment, TheCameraIsAsFarFromTheTruthAsItsCovarianceSays) {
  const SE3 error{so3::exp({0.005, -0.003, 0.01}), Eigen::Vector3d::Zero()};
  const BundleDive dive = bundle_dive(1.01, error);
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  Eigen::Matrix<double, 9, 1> differences;
  differences << so3::log(mounting().rotation.conjugate() * result->camera.T_body_camera.rotation),
      result->camera.T_body_camera.translation - mounting().translation,
      std::log(result->camera.lens.scale / 1.01), result->camera.lens.offset;
  const Eigen::Matrix<double, 9, 9>& covariance = result->camera.covariance;
  const double mahalanobis = differences.dot(covariance.ldlt().solve(differences));
  EXPECT_LT(mahalanobis, 21.7);  // 99 % of 9 degrees of freedom
  EXPECT_GT(mahalanobis, 0.5);
  EXPECT_LT(std::sqrt(covariance(6, 6)), 0.005);
}

TEST(BundleAdjustment, WhatIsNotEstimatedOfTheCameraStays) {
  const BundleDive dive = bundle_dive(1.01);
  BundleOptions options = options_of(dive);
  options.prior = {.T_body_camera = dive.T_body_camera};
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->camera.lens.scale, 1.0);
  EXPECT_EQ(result->camera.T_body_camera.translation, mounting().translation);
  EXPECT_LT(so3::angle_between(result->camera.T_body_camera.rotation, mounting().rotation), 1e-9);
}

TEST(BundleAdjustment, HeightsHoldTheVertical) {
  BundleDive dive = bundle_dive();
  for (std::size_t k = 0; k < dive.views.size(); ++k) {
    dive.views[k].T_world_body.translation.z() += 0.1;
    dive.views[k].height = ViewHeight{dive.truth[k].translation.z(), 0.01};
  }
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  for (std::size_t k = 0; k < dive.truth.size(); ++k) {
    EXPECT_NEAR(result->T_world_body[k].translation.z(), dive.truth[k].translation.z(), 0.01);
  }
}

TEST(BundleAdjustment, AFixInAKnownMapMovesEveryView) {
  BundleDive dive = bundle_dive();
  const SE3 shift{Eigen::Quaterniond::Identity(), {0.2, -0.1, 0.0}};
  for (const std::size_t k : {0U, 16U, 32U}) {
    dive.views[k].fixes.push_back({shift * dive.truth[k] * mounting(), {0.001, 0.001, 0.001}});
  }
  const auto result = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(result);
  for (std::size_t k = 0; k < dive.truth.size(); ++k) {
    const SE3 expected = shift * dive.truth[k] * mounting();
    const SE3 found = result->T_world_body[k] * result->camera.T_body_camera;
    EXPECT_LT((found.translation - expected.translation).norm(), 0.005);
  }
}

TEST(BundleAdjustment, ViewsThatShareNothingAreNotAdjusted) {
  BundleDive dive = bundle_dive();
  cv::RNG random(1);
  for (Place& place : dive.places) random.fill(place.descriptors, cv::RNG::UNIFORM, 0, 90);
  EXPECT_FALSE(adjust_bundle(dive.views, test::floor_camera(), options_of(dive)));
}

TEST(BundleAdjustment, ViewsThatOdometryAloneJoinsAreNotAdjusted) {
  const BundleDive dive = bundle_dive();
  std::vector<BundleView> far_apart;  // 4 m on, over what the camera sees
  for (std::size_t k = 0; k < dive.views.size(); k += 10) far_apart.push_back(dive.views[k]);
  EXPECT_FALSE(adjust_bundle(far_apart, test::floor_camera(), options_of(dive)));
}

TEST(BundleAdjustment, TwoRunsGiveTheSameBits) {
  const BundleDive dive = bundle_dive();
  const auto a = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  const auto b = adjust_bundle(dive.views, test::floor_camera(), options_of(dive));
  ASSERT_TRUE(a && b);
  for (std::size_t k = 0; k < dive.views.size(); ++k) {
    EXPECT_EQ(a->T_world_body[k].translation, b->T_world_body[k].translation);
    EXPECT_EQ(a->T_world_body[k].rotation.coeffs(), b->T_world_body[k].rotation.coeffs());
  }
}

}  // namespace
}  // namespace apvi::loop_closure
