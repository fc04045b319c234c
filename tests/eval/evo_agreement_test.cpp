// SPDX-License-Identifier: BSD-3-Clause
// Agreement with the Python package evo (https://github.com/MichaelGrupp/evo).
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "apvi/io/tum.hpp"
#include "eval/synthetic_pair.hpp"
#include "eval/trajectory_metrics.hpp"
#include "support/test_data.hpp"

namespace apvi::eval {
namespace {

constexpr double kTolerance = 1e-6;

EvalOptions options_with(Association mode) {
  EvalOptions options;
  options.association.mode = mode;
  return options;
}

void expect_statistics(const ErrorMetric& metric, const Statistics& expected) {
  ASSERT_TRUE(metric.value.has_value()) << to_string(metric.reason);
  EXPECT_NEAR(metric.value->rmse, expected.rmse, kTolerance);
  EXPECT_NEAR(metric.value->mean, expected.mean, kTolerance);
  EXPECT_NEAR(metric.value->median, expected.median, kTolerance);
  EXPECT_NEAR(metric.value->std, expected.std, kTolerance);
  EXPECT_NEAR(metric.value->min, expected.min, kTolerance);
  EXPECT_NEAR(metric.value->max, expected.max, kTolerance);
}

// `synthetic_pair` written as TUM files, evo 1.37.0: evo_ape tum ref est -a
constexpr Statistics kEvo137ApeAlign{.rmse = 0.36347892586200237,
                                     .mean = 0.34248771224160773,
                                     .median = 0.33095508498085924,
                                     .std = 0.12173371147428592,
                                     .min = 0.01970056229017579,
                                     .max = 0.5956394823994511};
// evo 1.37.0: evo_ape tum ref est --align_origin
constexpr Statistics kEvo137ApeAlignOrigin{.rmse = 0.39096198140958804,
                                           .mean = 0.3700005607955244,
                                           .median = 0.4104816029007725,
                                           .std = 0.1262966979723087,
                                           .min = 0.0,
                                           .max = 0.5562010785378825};
// evo 1.37.0: evo_ape tum ref est -a -r angle_deg
constexpr Statistics kEvo137ApeAngle{.rmse = 4.538200600972971,
                                     .mean = 4.045845261597629,
                                     .median = 4.243915922221241,
                                     .std = 2.0558212018265225,
                                     .min = 0.13635850201039812,
                                     .max = 7.6301682132822775};
// evo 1.37.0: evo_rpe tum ref est -d 10 -u m
constexpr Statistics kEvo137Rpe10m{.rmse = 0.8282250745681246,
                                   .mean = 0.755679025902901,
                                   .median = 0.77064247853098,
                                   .std = 0.3389778517157399,
                                   .min = 0.24749660981042065,
                                   .max = 1.2320703554876138};
// evo 1.37.0: evo_rpe tum ref est -d 10 -u m --all_pairs
constexpr Statistics kEvo137Rpe10mAllPairs{.rmse = 0.7136447459049741,
                                           .mean = 0.6361987055173872,
                                           .median = 0.6806801595803067,
                                           .std = 0.32332650750561065,
                                           .min = 0.038190786661878605,
                                           .max = 1.3496471225117388};

TEST(EvoAgreement, NearestAssociationMatchesEvo) {
  const test::TrajectoryPair pair = test::synthetic_pair();
  const TrajectoryMetrics m =
      evaluate(pair.reference, pair.estimate, options_with(Association::nearest));
  EXPECT_EQ(m.matched, 552u);
  expect_statistics(m.ate, kEvo137ApeAlign);
  expect_statistics(m.ate_first_pose, kEvo137ApeAlignOrigin);
  expect_statistics(m.rotation_deg, kEvo137ApeAngle);
  expect_statistics(m.rpe_distance, kEvo137Rpe10m);
  expect_statistics(m.rpe_distance_all_pairs, kEvo137Rpe10mAllPairs);
}

// evo 1.38.1: evo_ape tum ref est -a --sync_method interpolation
constexpr Statistics kEvo138ApeInterpolated{.rmse = 0.3635662125604316,
                                            .mean = 0.34253098978041696,
                                            .median = 0.33149620231182825,
                                            .std = 0.12187252338236376,
                                            .min = 0.0204377770900353,
                                            .max = 0.5956838432548484};
// evo 1.38.1: evo_rpe tum ref est -d 10 -u m --all_pairs --sync_method interpolation
constexpr double kEvo138Rpe10mAllPairsInterpolatedRmse = 0.7142707069578214;

TEST(EvoAgreement, InterpolationMatchesEvo) {
  const test::TrajectoryPair pair = test::synthetic_pair();
  const TrajectoryMetrics m = evaluate(pair.reference, pair.estimate);
  expect_statistics(m.ate, kEvo138ApeInterpolated);
  EXPECT_NEAR(m.rpe_distance_all_pairs.value->rmse, kEvo138Rpe10mAllPairsInterpolatedRmse,
              kTolerance);
}

// evo 1.37.0: evo_rpe tum ref est -d 10 -u f --all_pairs, with the estimate's poses of the first 20
// s only: evenly sampled, so that ten frames are one second.
constexpr double kEvo137RpeTenFramesRmse = 0.11138734930718479;

TEST(EvoAgreement, OneSecondEqualsTenFramesWhenEvenlySampled) {
  test::TrajectoryPair pair = test::synthetic_pair();
  pair.estimate = within(pair.estimate, Stamp::min(), pair.reference.poses[400].stamp);
  const TrajectoryMetrics m =
      evaluate(pair.reference, pair.estimate, options_with(Association::nearest));
  EXPECT_NEAR(m.rpe_time.value->rmse, kEvo137RpeTenFramesRmse, kTolerance);
}

TEST(EvoAgreement, ReproducesStoredEvoResults) {
  APVI_NEEDS_DATA(folder, "evo_reference");
  const auto expected = nlohmann::json::parse(std::ifstream(folder / "expected.json"));
  const Trajectory reference = io::read_trajectory(folder / "KITTI_00_gt.tum");
  for (const std::string name : {"KITTI_00_ORB", "KITTI_00_SPTAM"}) {
    SCOPED_TRACE(name);
    const Trajectory estimate = io::read_trajectory(folder / (name + ".tum"));
    for (const Association mode : {Association::nearest, Association::interpolate}) {
      const TrajectoryMetrics m = evaluate(reference, estimate, options_with(mode));
      const auto& ape = expected.at("ape_translation_se3_umeyama").at(name);
      EXPECT_NEAR(m.ate.value->rmse, ape.at("rmse").get<double>(), kTolerance);
      EXPECT_NEAR(m.ate.value->mean, ape.at("mean").get<double>(), kTolerance);
      EXPECT_NEAR(m.ate.value->median, ape.at("median").get<double>(), kTolerance);
      EXPECT_NEAR(m.ate.value->std, ape.at("std").get<double>(), kTolerance);
      EXPECT_NEAR(m.ate.value->max, ape.at("max").get<double>(), kTolerance);
      const auto& rpe = expected.at("rpe_translation_delta_10m_consecutive").at(name);
      EXPECT_NEAR(m.rpe_distance.value->rmse, rpe.at("rmse").get<double>(), kTolerance);
      EXPECT_NEAR(m.rpe_distance.value->mean, rpe.at("mean").get<double>(), kTolerance);
      EXPECT_NEAR(m.rpe_distance.value->median, rpe.at("median").get<double>(), kTolerance);
    }
  }
}

}  // namespace
}  // namespace apvi::eval
