// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/discriminator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/so3.hpp"
#include "fusion/random_pose.hpp"

namespace apvi::fusion {
namespace {

vio::FrameStatistics corners(int tracked, int detected, int stable) {
  vio::FrameStatistics statistics;
  statistics.tracked = tracked;
  statistics.detected = detected;
  statistics.stable = stable;
  return statistics;
}

TEST(Discriminator, DefaultsMatchThePaper) {
  const DiscriminatorConfig config;
  EXPECT_EQ(config.tracking.min_features, 50);
  EXPECT_EQ(config.tracking.min_stable_ratio, 0.2);
  EXPECT_EQ(config.agreement.max_position_m, 0.3);
  EXPECT_EQ(config.agreement.max_height_m, 0.3);
  EXPECT_EQ(config.agreement.max_rotation_deg, 10.0);
}

TEST(TrackingCheck, RequiresMoreThanFiftyFeatures) {
  const Verdict at = check_tracking(corners(50, 0, 50), {});
  EXPECT_EQ(at.level, Level::coarse);
  EXPECT_EQ(at.reason, Reason::too_few_features);
  EXPECT_EQ(at.measured, 50.0);
  EXPECT_EQ(at.threshold, 50.0);
  EXPECT_FALSE(check_tracking(corners(49, 0, 49), {}).accepted());
  EXPECT_TRUE(check_tracking(corners(51, 0, 51), {}).accepted());
}

TEST(TrackingCheck, CountsNewCorners) {
  EXPECT_TRUE(check_tracking(corners(30, 21, 30), {}).accepted());
  EXPECT_EQ(check_tracking(corners(30, 20, 30), {}).reason, Reason::too_few_features);
}

TEST(TrackingCheck, RequiresMoreThanAFifthStable) {
  for (int features = 55; features <= 1000; features += 5) {
    const Verdict at = check_tracking(corners(features, 0, features / 5), {});
    EXPECT_EQ(at.reason, Reason::too_few_stable) << features;
    EXPECT_DOUBLE_EQ(at.measured, 0.2);
    EXPECT_TRUE(check_tracking(corners(features, 0, features / 5 + 1), {}).accepted()) << features;
    EXPECT_FALSE(check_tracking(corners(features, 0, features / 5 - 1), {}).accepted()) << features;
  }
}

TEST(TrackingCheck, RejectsFramesWithoutFeatures) {
  EXPECT_EQ(check_tracking(corners(0, 0, 0), {}).reason, Reason::too_few_features);
  TrackingCheckConfig any;
  any.min_features = 0;
  EXPECT_EQ(check_tracking(corners(0, 0, 0), any).reason, Reason::too_few_features);
}

TEST(TrackingCheck, SpreadIsTestedOnlyIfConfigured) {
  vio::FrameStatistics statistics = corners(100, 0, 100);
  statistics.spread = 0.25;
  EXPECT_TRUE(check_tracking(statistics, {}).accepted());
  TrackingCheckConfig config;
  config.min_grid_coverage = 0.25;
  EXPECT_TRUE(check_tracking(statistics, config).accepted());
  config.min_grid_coverage = std::nextafter(0.25, 1.0);
  const Verdict verdict = check_tracking(statistics, config);
  EXPECT_EQ(verdict.reason, Reason::too_little_spread);
  EXPECT_EQ(verdict.measured, 0.25);
}

SE3 at(double x, double y, double z) {
  return {Eigen::Quaterniond::Identity(), {x, y, z}};
}

TEST(AgreementCheck, RejectsAtThirtyCentimeters) {
  const Verdict verdict = check_agreement(at(0.0, 0.0, 0.0), at(0.3, 0.0, 0.0), {});
  EXPECT_EQ(verdict.level, Level::medium);
  EXPECT_EQ(verdict.reason, Reason::position_differs);
  EXPECT_EQ(verdict.measured, 0.3);
  EXPECT_EQ(verdict.threshold, 0.3);
  EXPECT_TRUE(
      check_agreement(at(0.0, 0.0, 0.0), at(std::nextafter(0.3, 0.0), 0.0, 0.0), {}).accepted());
  EXPECT_FALSE(
      check_agreement(at(0.0, 0.0, 0.0), at(std::nextafter(0.3, 1.0), 0.0, 0.0), {}).accepted());
  EXPECT_FALSE(check_agreement(at(0.2, 0.2, 0.2), at(0.0, 0.0, 0.0), {}).accepted());  // 0.35 m
}

TEST(AgreementCheck, HeightHasASeparateThreshold) {
  AgreementCheckConfig config;
  config.max_height_m = 0.125;
  const Verdict verdict = check_agreement(at(0.0, 0.0, 1.0), at(0.0, 0.0, 1.125), config);
  EXPECT_EQ(verdict.reason, Reason::height_differs);
  EXPECT_EQ(verdict.measured, 0.125);
  EXPECT_EQ(verdict.threshold, 0.125);
  EXPECT_TRUE(check_agreement(at(0.1, 0.1, 1.0), at(0.0, 0.0, 1.124), config).accepted());
  EXPECT_TRUE(check_agreement(at(0.2, 0.0, 0.0), at(0.0, 0.0, 0.0), config).accepted());
}

TEST(AgreementCheck, RejectsTenDegreesAboutAnyAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    const auto turned = [axis](double degrees) {
      return SE3{so3::exp(degrees * kRadiansPerDegree * Eigen::Vector3d::Unit(axis)),
                 Eigen::Vector3d::Zero()};
    };
    EXPECT_TRUE(check_agreement(SE3{}, turned(10.0 - 1e-9), {}).accepted());
    const Verdict verdict = check_agreement(turned(10.0 + 1e-9), SE3{}, {});
    EXPECT_EQ(verdict.reason, Reason::rotation_differs);
    EXPECT_NEAR(verdict.measured, 10.0, 1e-6);
    EXPECT_EQ(verdict.threshold, 10.0);
  }
  // Exactly at the threshold, where the angle has no rounding error.
  AgreementCheckConfig config;
  config.max_rotation_deg = 0.0;
  EXPECT_EQ(check_agreement(SE3{}, SE3{}, config).reason, Reason::rotation_differs);
}

TEST(AgreementCheck, CovarianceGrowthAndReductionBothWidenTheLimits) {
  AgreementCheckConfig config;
  config.dipo_sigmas = 3.0;
  PoseEstimate before;
  before.T_world_body.rotation = so3::exp(Eigen::Vector3d(0.3, -1.2, 0.7));
  PoseEstimate after = before;
  after.covariance.diagonal() += Vector6(0.03, -0.03, 0.03, -0.02, 0.03, 0.04);
  DriftVariance drift;
  EXPECT_EQ(widen_limits(config, drift).max_rotation_deg, 10.0);
  drift.add(before, after);
  const DriftVariance first = drift;
  drift.add(after, before);  // back to the initial covariance, which adds drift too
  for (const DriftVariance& half : {first, drift.since(first)}) {
    const AgreementCheckConfig wide = widen_limits(config, half);
    EXPECT_NEAR(wide.max_rotation_deg, 0.9 / kRadiansPerDegree, 1e-9);  // three times 0.3 rad
    EXPECT_NEAR(wide.max_position_m, 0.9, 1e-9);
    EXPECT_NEAR(wide.max_height_m, 0.6, 1e-9);
  }
  EXPECT_NEAR(widen_limits(config, drift).max_position_m, 0.9 * std::sqrt(2.0), 1e-9);
  config.dipo_sigmas = 0.0;
  EXPECT_EQ(widen_limits(config, drift).max_position_m, 0.3);
}

TEST(AgreementCheck, PureRotationAddsNoDrift) {
  PoseEstimate before;
  before.covariance.diagonal().head<3>() = Eigen::Vector3d(1e-4, 1e-4, 1.0);  // heading unknown
  PoseEstimate after = before;
  after.T_world_body.rotation = so3::exp(Eigen::Vector3d(1.5, 0.0, 0.0));
  const Eigen::Matrix3d R = after.T_world_body.rotation.toRotationMatrix();
  after.covariance.topLeftCorner<3, 3>() =
      R.transpose() * before.covariance.topLeftCorner<3, 3>() * R;
  DriftVariance drift;
  drift.add(before, after);
  EXPECT_NEAR(drift.rotation, 0.0, 1e-12);
}

TEST(AgreementCheck, RejectsNonFinitePoses) {
  EXPECT_FALSE(check_agreement(SE3{}, at(NAN, 0.0, 0.0), {}).accepted());
}

TEST(DegeneracyCheck, RejectsEigenvaluesBelowTheThreshold) {
  const Eigenvalues e{{100.0, 200.0, 300.0}, {10.0, 20.0, 30.0}};
  EXPECT_TRUE(check_degeneracy(e, {100.0, 10.0}).accepted());
  const Verdict rotation = check_degeneracy(e, {std::nextafter(100.0, 101.0), 10.0});
  EXPECT_EQ(rotation.level, Level::fine);
  EXPECT_EQ(rotation.reason, Reason::rotation_degenerate);
  EXPECT_EQ(rotation.measured, 100.0);
  const Verdict position = check_degeneracy(e, {100.0, 10.5});
  EXPECT_EQ(position.reason, Reason::position_degenerate);
  EXPECT_EQ(position.measured, 10.0);
  EXPECT_EQ(position.threshold, 10.5);
}

TEST(DegeneracyCheck, ZeroThresholdIsNotTested) {
  EXPECT_TRUE(check_degeneracy({{-1e-9, 0.0, 0.0}, {-1e-9, 0.0, 0.0}}, {}).accepted());
}

TEST(DegeneracyCheck, UsesWindowInformationAndNormalization) {
  VioEstimate vio;
  vio.information = 50.0 * Matrix6::Identity();
  vio.inliers = 25;
  EXPECT_NEAR(tested_eigenvalues(vio, {}).position(0), 50.0, 1e-12);
  vio.window_information = 100.0 * Matrix6::Identity();
  EXPECT_NEAR(tested_eigenvalues(vio, {}).position(0), 100.0, 1e-12);
  DegeneracyCheckConfig config;
  config.normalization = Normalization::per_inlier;
  EXPECT_NEAR(tested_eigenvalues(vio, config).rotation(0), 4.0, 1e-12);
}

TEST(DegeneracyCheck, ThresholdsScaleWithSquaredFocalLength) {
  const DegeneracyCheckConfig config{.min_rotation_eigenvalue = 4e6,
                                     .min_position_eigenvalue = 400.0,
                                     .reference_focal_px = 420.0};
  const DegeneracyCheckConfig half = scale_to_camera(config, 210.0);
  EXPECT_NEAR(half.min_rotation_eigenvalue, 1e6, 1e-6);
  EXPECT_NEAR(half.min_position_eigenvalue, 100.0, 1e-12);
  EXPECT_NEAR(scale_to_camera(half, 420.0).min_rotation_eigenvalue, config.min_rotation_eigenvalue,
              1e-6);
  EXPECT_EQ(scale_to_camera(config, 420.0).min_position_eigenvalue, config.min_position_eigenvalue);
}

TEST(DegeneracyCheck, ThresholdsWithoutReferenceFocalLengthAreNotScaled) {
  const DegeneracyCheckConfig config{
      .min_rotation_eigenvalue = 4e6, .min_position_eigenvalue = 400.0, .reference_focal_px = 0.0};
  EXPECT_EQ(scale_to_camera(config, 210.0).min_rotation_eigenvalue, 4e6);
  EXPECT_EQ(scale_to_camera(config, 210.0).min_position_eigenvalue, 400.0);
}

TEST(Discriminator, ReasonNamesAreUnique) {
  std::set<std::string_view> words;
  for (int i = 0; i <= static_cast<int>(Reason::position_degenerate); ++i) {
    words.insert(to_string(static_cast<Reason>(i)));
  }
  EXPECT_EQ(words.size(), static_cast<std::size_t>(Reason::position_degenerate) + 1);
}

}  // namespace
}  // namespace apvi::fusion
