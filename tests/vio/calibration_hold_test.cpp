// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/calibration_hold.hpp"

#include <gtest/gtest.h>

#include "support/simulated_dive.hpp"

namespace apvi::vio {
namespace {

Rig rig_with_sound_speed(double scale) {
  Rig rig = test::SimulatedDive::rig();
  rig.dvl->scale = scale;
  return rig;
}

CalibrationParameter estimate(const std::string& name, double change, double sigma) {
  return {.name = name,
          .change = Eigen::VectorXd::Constant(1, change),
          .sigma = Eigen::VectorXd::Constant(1, sigma),
          .prior_sigma = 0.01};
}

struct Held {
  Rig rig = rig_with_sound_speed(1.0);
  CalibrationConfig config;
  Calibration calibration = calibration_of(rig);
  CalibrationHold hold{calibration, config, rig};
};

/// Half the squared residual of the hold at the present values.
double cost(const CalibrationHold& hold) {
  const PriorFactor factor(hold.prior());
  std::vector<const double*> values;
  for (const Prior::Kept& kept : hold.prior()->kept) values.push_back(kept.block.data);
  Eigen::VectorXd r(factor.num_residuals());
  factor.Evaluate(values.data(), r.data(), nullptr);
  return 0.5 * r.squaredNorm();
}

TEST(CalibrationHold, PullsEstimatedParametersToTheRig) {
  Held all;
  EXPECT_TRUE(all.hold.holds("cam0.mounting"));
  EXPECT_TRUE(all.hold.holds("dvl0.lever_arm"));
  EXPECT_EQ(cost(all.hold), 0.0);
  all.calibration.lenses[0][0] = all.config.focal_length.sigma;
  EXPECT_GT(cost(all.hold), 1000.0);
}

TEST(CalibrationHold, LeavesTheScaleOfADvlWithoutAMeasuredSpeedOfSound) {
  Held all;
  EXPECT_FALSE(all.hold.holds("dvl0.scale"));
  const Rig measured = rig_with_sound_speed(0.99);
  EXPECT_TRUE(CalibrationHold(all.calibration, all.config, measured).holds("dvl0.scale"));
}

TEST(CalibrationHold, ReleasesOnlyWhatTheMeasurementsContradict) {
  Held all;
  all.hold.update(
      {estimate("cam0.focal_length", 0.012, 0.002), estimate("cam0.time_offset_s", 0.003, 0.001)});
  EXPECT_FALSE(all.hold.holds("cam0.focal_length"));
  EXPECT_TRUE(all.hold.holds("cam0.time_offset_s"));
  all.calibration.lenses[0][0] = 0.01;
  EXPECT_EQ(cost(all.hold), 0.0);
  all.calibration.lenses[0][1] = 0.01;  // the principal point shares the block
  EXPECT_GT(cost(all.hold), 1.0);
}

// The prior's standard deviation is 1 %.
TEST(CalibrationHold, KeepsWhatDiffersByLessThanTheErrorOfTheModel) {
  Held all;
  all.hold.update({estimate("cam0.focal_length", 0.0035, 1e-6)});
  EXPECT_TRUE(all.hold.holds("cam0.focal_length"));
}

TEST(CalibrationHold, ReleasesAllOnceOneParameterIsFarOff) {
  Held all;
  all.hold.update({estimate("cam0.focal_length", 0.02, 0.001)});
  EXPECT_FALSE(all.hold.holds_any());
  EXPECT_EQ(all.hold.prior(), nullptr);
}

TEST(CalibrationHold, HoldsNothingWithoutALimitOrWithoutSelfCalibration) {
  Held all;
  CalibrationConfig free;
  free.release_sigmas = 0.0;
  EXPECT_FALSE(CalibrationHold(all.calibration, free, all.rig).holds_any());
  const CalibrationHold fixed(all.calibration, CalibrationConfig::fixed(), all.rig);
  EXPECT_EQ(fixed.prior(), nullptr);
}

}  // namespace
}  // namespace apvi::vio
