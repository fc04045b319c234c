// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/fusion/discriminator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/so3.hpp"
#include "random_pose.hpp"

namespace apvi::fusion {
namespace {

vio::FrameStatistics corners(int tracked, int detected, int stable) {
  vio::FrameStatistics statistics;
  statistics.tracked = tracked;
  statistics.detected = detected;
  statistics.stable = stable;
  return statistics;
}

TEST(Discriminator, TheDefaultsAreThePapersNumbers) {
  const DiscriminatorConfig config;
  EXPECT_EQ(config.coarse.min_features, 50);
  EXPECT_EQ(config.coarse.min_stable_ratio, 0.2);
  EXPECT_EQ(config.medium.max_position_m, 0.3);
  EXPECT_EQ(config.medium.max_height_m, 0.3);
  EXPECT_EQ(config.medium.max_rotation_deg, 10.0);
}

TEST(Coarse, FiftyFeaturesAreTooFewAndFiftyOneEnough) {
  const Verdict at = coarse(corners(50, 0, 50), {});
  EXPECT_EQ(at.level, Level::coarse);
  EXPECT_EQ(at.reason, Reason::too_few_features);
  EXPECT_EQ(at.measured, 50.0);
  EXPECT_EQ(at.threshold, 50.0);
  EXPECT_FALSE(coarse(corners(49, 0, 49), {}).accepted());
  EXPECT_TRUE(coarse(corners(51, 0, 51), {}).accepted());
}

TEST(Coarse, NewCornersCountAsFeatures) {
  EXPECT_TRUE(coarse(corners(30, 21, 30), {}).accepted());
  EXPECT_EQ(coarse(corners(30, 20, 30), {}).reason, Reason::too_few_features);
}

TEST(Coarse, AFifthOfStableFeaturesIsTooFewAndOneMoreEnough) {
  for (int features = 55; features <= 1000; features += 5) {
    const Verdict at = coarse(corners(features, 0, features / 5), {});
    EXPECT_EQ(at.reason, Reason::too_few_stable) << features;
    EXPECT_DOUBLE_EQ(at.measured, 0.2);
    EXPECT_TRUE(coarse(corners(features, 0, features / 5 + 1), {}).accepted()) << features;
    EXPECT_FALSE(coarse(corners(features, 0, features / 5 - 1), {}).accepted()) << features;
  }
}

TEST(Coarse, NoFeaturesAtAllAreTooFew) {
  EXPECT_EQ(coarse(corners(0, 0, 0), {}).reason, Reason::too_few_features);
  CoarseConfig any;
  any.min_features = 0;
  EXPECT_EQ(coarse(corners(0, 0, 0), any).reason, Reason::too_few_features);
}

TEST(Coarse, SpreadIsAskedForOnlyIfConfigured) {
  vio::FrameStatistics statistics = corners(100, 0, 100);
  statistics.spread = 0.25;
  EXPECT_TRUE(coarse(statistics, {}).accepted());
  CoarseConfig config;
  config.min_spread = 0.25;
  EXPECT_TRUE(coarse(statistics, config).accepted());
  config.min_spread = std::nextafter(0.25, 1.0);
  const Verdict verdict = coarse(statistics, config);
  EXPECT_EQ(verdict.reason, Reason::too_little_spread);
  EXPECT_EQ(verdict.measured, 0.25);
}

SE3 at(double x, double y, double z) {
  return {Eigen::Quaterniond::Identity(), {x, y, z}};
}

TEST(Medium, ThirtyCentimetresApartIsTooFarAndLessIsNot) {
  const Verdict verdict = medium(at(0.0, 0.0, 0.0), at(0.3, 0.0, 0.0), {});
  EXPECT_EQ(verdict.level, Level::medium);
  EXPECT_EQ(verdict.reason, Reason::position_differs);
  EXPECT_EQ(verdict.measured, 0.3);
  EXPECT_EQ(verdict.threshold, 0.3);
  EXPECT_TRUE(medium(at(0.0, 0.0, 0.0), at(std::nextafter(0.3, 0.0), 0.0, 0.0), {}).accepted());
  EXPECT_FALSE(medium(at(0.0, 0.0, 0.0), at(std::nextafter(0.3, 1.0), 0.0, 0.0), {}).accepted());
  EXPECT_FALSE(medium(at(0.2, 0.2, 0.2), at(0.0, 0.0, 0.0), {}).accepted());  // 0.35 m
}

TEST(Medium, HeightHasAThresholdOfItsOwn) {
  MediumConfig config;
  config.max_height_m = 0.125;
  const Verdict verdict = medium(at(0.0, 0.0, 1.0), at(0.0, 0.0, 1.125), config);
  EXPECT_EQ(verdict.reason, Reason::height_differs);
  EXPECT_EQ(verdict.measured, 0.125);
  EXPECT_EQ(verdict.threshold, 0.125);
  EXPECT_TRUE(medium(at(0.1, 0.1, 1.0), at(0.0, 0.0, 1.124), config).accepted());
  EXPECT_TRUE(medium(at(0.2, 0.0, 0.0), at(0.0, 0.0, 0.0), config).accepted());
}

TEST(Medium, TenDegreesOfTurnAreTooManyAboutAnyAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    const auto turned = [axis](double degrees) {
      return SE3{so3::exp(degrees * kRadiansPerDegree * Eigen::Vector3d::Unit(axis)),
                 Eigen::Vector3d::Zero()};
    };
    EXPECT_TRUE(medium(SE3{}, turned(10.0 - 1e-9), {}).accepted());
    const Verdict verdict = medium(turned(10.0 + 1e-9), SE3{}, {});
    EXPECT_EQ(verdict.reason, Reason::rotation_differs);
    EXPECT_NEAR(verdict.measured, 10.0, 1e-6);
    EXPECT_EQ(verdict.threshold, 10.0);
  }
  // Exactly at the threshold, where the angle has no rounding.
  MediumConfig config;
  config.max_rotation_deg = 0.0;
  EXPECT_EQ(medium(SE3{}, SE3{}, config).reason, Reason::rotation_differs);
}

TEST(Medium, WhatDipoLosesAndWhatItLearnsBothWidenTheLimits) {
  MediumConfig config;
  config.dipo_sigmas = 3.0;
  PoseEstimate before;
  before.T_world_body.rotation = so3::exp(Eigen::Vector3d(0.3, -1.2, 0.7));
  PoseEstimate after = before;
  after.covariance.diagonal() += Vector6(0.03, -0.03, 0.03, -0.02, 0.03, 0.04);
  Wander wander;
  EXPECT_EQ(widened(config, wander).max_rotation_deg, 10.0);
  wander.add(before, after);
  const Wander first = wander;
  wander.add(after, before);  // back where it was, which does not undo anything
  for (const Wander& half : {first, wander.since(first)}) {
    const MediumConfig wide = widened(config, half);
    EXPECT_NEAR(wide.max_rotation_deg, 0.9 / kRadiansPerDegree, 1e-9);  // three times 0.3 rad
    EXPECT_NEAR(wide.max_position_m, 0.9, 1e-9);
    EXPECT_NEAR(wide.max_height_m, 0.6, 1e-9);
  }
  EXPECT_NEAR(widened(config, wander).max_position_m, 0.9 * std::sqrt(2.0), 1e-9);
  config.dipo_sigmas = 0.0;
  EXPECT_EQ(widened(config, wander).max_position_m, 0.3);
}

TEST(Medium, ABodyThatOnlyTurnsHasNotWandered) {
  PoseEstimate before;
  before.covariance.diagonal().head<3>() = Eigen::Vector3d(1e-4, 1e-4, 1.0);  // heading unknown
  PoseEstimate after = before;
  after.T_world_body.rotation = so3::exp(Eigen::Vector3d(1.5, 0.0, 0.0));
  const Eigen::Matrix3d R = after.T_world_body.rotation.toRotationMatrix();
  after.covariance.topLeftCorner<3, 3>() =
      R.transpose() * before.covariance.topLeftCorner<3, 3>() * R;
  Wander wander;
  wander.add(before, after);
  EXPECT_NEAR(wander.rotation, 0.0, 1e-12);
}

TEST(Medium, WhatIsNotANumberNeverPasses) {
  EXPECT_FALSE(medium(SE3{}, at(NAN, 0.0, 0.0), {}).accepted());
}

TEST(Fine, AnEigenvalueBelowItsThresholdFailsAndAtItDoesNot) {
  const Eigenvalues e{{100.0, 200.0, 300.0}, {10.0, 20.0, 30.0}};
  EXPECT_TRUE(fine(e, {100.0, 10.0}).accepted());
  const Verdict rotation = fine(e, {std::nextafter(100.0, 101.0), 10.0});
  EXPECT_EQ(rotation.level, Level::fine);
  EXPECT_EQ(rotation.reason, Reason::rotation_degenerate);
  EXPECT_EQ(rotation.measured, 100.0);
  const Verdict position = fine(e, {100.0, 10.5});
  EXPECT_EQ(position.reason, Reason::position_degenerate);
  EXPECT_EQ(position.measured, 10.0);
  EXPECT_EQ(position.threshold, 10.5);
}

TEST(Fine, AThresholdOfZeroIsNotTested) {
  EXPECT_TRUE(fine({{-1e-9, 0.0, 0.0}, {-1e-9, 0.0, 0.0}}, {}).accepted());
}

TEST(Fine, TestsTheWindowsInformationWhereThereIsOneAndPerInlierIfConfigured) {
  VioEstimate vio;
  vio.information = 50.0 * Matrix6::Identity();
  vio.inliers = 25;
  EXPECT_NEAR(tested_eigenvalues(vio, {}).position(0), 50.0, 1e-12);
  vio.window_information = 100.0 * Matrix6::Identity();
  EXPECT_NEAR(tested_eigenvalues(vio, {}).position(0), 100.0, 1e-12);
  FineConfig config;
  config.normalisation = Normalisation::per_inlier;
  EXPECT_NEAR(tested_eigenvalues(vio, config).rotation(0), 4.0, 1e-12);
}

TEST(Fine, ThresholdsGoWithTheSquareOfTheFocalLength) {
  const FineConfig config{.min_rotation = 4e6, .min_position = 400.0, .focal_px = 420.0};
  const FineConfig half = for_camera(config, 210.0);
  EXPECT_NEAR(half.min_rotation, 1e6, 1e-6);
  EXPECT_NEAR(half.min_position, 100.0, 1e-12);
  EXPECT_NEAR(for_camera(half, 420.0).min_rotation, config.min_rotation, 1e-6);
  EXPECT_EQ(for_camera(config, 420.0).min_position, config.min_position);
}

TEST(Fine, ThresholdsForAnyCameraStayAsTheyAre) {
  const FineConfig config{.min_rotation = 4e6, .min_position = 400.0, .focal_px = 0.0};
  EXPECT_EQ(for_camera(config, 210.0).min_rotation, 4e6);
  EXPECT_EQ(for_camera(config, 210.0).min_position, 400.0);
}

TEST(Discriminator, EveryReasonHasAWordOfItsOwn) {
  std::set<std::string_view> words;
  for (int i = 0; i <= static_cast<int>(Reason::position_degenerate); ++i) {
    words.insert(to_string(static_cast<Reason>(i)));
  }
  EXPECT_EQ(words.size(), static_cast<std::size_t>(Reason::position_degenerate) + 1);
}

}  // namespace
}  // namespace apvi::fusion
