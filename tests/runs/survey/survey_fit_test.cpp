// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/survey_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/core/error.hpp"
#include "core/random.hpp"

namespace apvi::runs {
namespace {

Trajectory curve() {
  Trajectory trajectory;
  for (int i = 0; i < 50; ++i) {
    const double t = 0.5 * i;
    trajectory.poses.push_back({Stamp{static_cast<std::int64_t>(5e8) * i},
                                {Eigen::Quaterniond::Identity(), {t, 3.0 * std::sin(t), -2.0}}});
  }
  return trajectory;
}

/// Positions of the curve in a system, with noise.
Trajectory positions_in(const survey::Georeference& reference, double noise_m) {
  Random random(7);
  Trajectory positions = curve();
  positions.has_rotation = false;
  for (StampedPose& pose : positions.poses) {
    const Eigen::Vector3d noise(random.normal(), random.normal(), random.normal());
    pose.T_world_body.translation =
        reference.T_crs_world * pose.T_world_body.translation + noise_m * noise;
  }
  return positions;
}

TEST(FitGeoreference, ExactPositionsGiveOriginAndHeading) {
  for (const bool z_down : {false, true}) {
    const survey::Georeference truth =
        survey::georeference({32632, {691234.5, 5331234.5, 1.5}, 30.0}, z_down);
    const FittedGeoreference fit =
        fit_georeference(curve(), positions_in(truth, 0.0), 32632, z_down);
    EXPECT_NEAR(fit.heading_deg, 30.0, 1e-6);
    EXPECT_LT((fit.reference.T_crs_world.translation - truth.T_crs_world.translation).norm(), 1e-6);
    EXPECT_LT(fit.horizontal_rms_m, 1e-6);
    EXPECT_EQ(fit.fixes, 50U);
  }
}

TEST(FitGeoreference, ResidualsAreThoseOfTheNoise) {
  const survey::Georeference truth = survey::georeference({32632, {5.0, 6.0, 0.0}, 200.0}, false);
  const FittedGeoreference fit = fit_georeference(curve(), positions_in(truth, 0.5), 32632, false);
  EXPECT_NEAR(fit.horizontal_rms_m, 0.5 * std::sqrt(2.0), 0.15);
  EXPECT_GT(fit.horizontal_max_m, fit.horizontal_rms_m);
  EXPECT_NEAR(fit.heading_deg, 200.0 - 360.0, 3.0);
}

TEST(FitGeoreference, PositionsWithoutHeightsLeaveHeightsAsTheyAre) {
  const survey::Georeference truth = survey::georeference({32632, {5.0, 6.0, 4.0}, 10.0}, false);
  Trajectory positions = positions_in(truth, 0.0);
  positions.has_height = false;
  const FittedGeoreference fit = fit_georeference(curve(), positions, 32632, false);
  EXPECT_NEAR(fit.reference.T_crs_world.translation.z(), 0.0, 1e-9);
}

TEST(FitGeoreference, PositionsOfAnotherTimeAreRefused) {
  Trajectory positions = curve();
  for (StampedPose& pose : positions.poses) pose.stamp = pose.stamp + Duration{1'000'000'000'000};
  EXPECT_THROW(fit_georeference(curve(), positions, 32632, false), InputError);
}

}  // namespace
}  // namespace apvi::runs
