// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "fusion/combine.hpp"
#include "fusion/relative_filter.hpp"
#include "fusion/two_odometries.hpp"

// NEES of each fusion method over many dives in which VIO starts at the DIPO pose, fails for a
// while, and restarts there.
namespace apvi::fusion {
namespace {

constexpr int kSeeds = 100;
constexpr double kDuration_s = 80.0;
const std::vector<std::pair<double, double>> kSpans{{5.0, 40.0}, {45.0, 100.0}};
// 95 % interval of the mean of 100 draws of chi-square with six degrees of freedom, divided by six
// (normal approximation).
const double kHalfWidth = 1.96 * std::sqrt(2.0 / (6.0 * kSeeds));

using Frame = test::TwoOdometries::Frame;
using Method = std::function<PoseEstimate(const Frame&)>;
using MakeMethod = std::function<Method()>;

struct Score {
  double nees = 0.0;        ///< per degree of freedom
  double position_m = 0.0;  ///< RMS at the end
  double heading_deg = 0.0;
};

double nees(const PoseEstimate& estimate, const SE3& truth) {
  const Vector6 e = boxminus(truth, estimate.T_world_body);
  return e.dot(estimate.covariance.ldlt().solve(e));
}

Score score(const test::TwoOdometries& setup, const MakeMethod& make) {
  Score sum;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Method method = make();
    PoseEstimate last;
    const std::vector<Frame> frames = setup.run(seed, kDuration_s, kSpans);
    for (const Frame& frame : frames) last = method(frame);
    const Vector6 e = boxminus(frames.back().truth, last.T_world_body);
    sum.nees += nees(last, frames.back().truth) / 6.0;
    sum.position_m += e.tail<3>().squaredNorm();
    sum.heading_deg += e(2) * e(2);
  }
  return {sum.nees / kSeeds, std::sqrt(sum.position_m / kSeeds),
          std::sqrt(sum.heading_deg / kSeeds) / kRadiansPerDegree};
}

Method dipo_alone() {
  return [](const Frame& f) { return f.dipo; };
}

Method vio_alone() {
  return [](const Frame& f) { return f.vio.value_or(f.dipo); };
}

Method as_printed() {
  return [](const Frame& f) {
    return f.vio ? fuse_independent(f.dipo, f.vio->T_world_body, f.vio->covariance.inverse())
                 : f.dipo;
  };
}

Method intersection() {
  return [](const Frame& f) {
    return f.vio ? intersect_covariances(f.dipo, f.vio->T_world_body, f.vio->covariance.inverse())
                       .estimate
                 : f.dipo;
  };
}

MakeMethod relative(double shared_noise) {
  return [shared_noise] {
    RelativeConfig config;
    config.shared_noise_fraction = shared_noise;
    const auto filter = std::make_shared<RelativeFilter>(config);
    return [filter](const Frame& f) {
      std::optional<RelativeFilter::VioPose> seen;
      if (f.vio) seen = {*f.vio, {}, {}};
      filter->step(Stamp{} + Duration::from_seconds(f.t), f.dipo, seen);
      return filter->estimate();
    };
  };
}

std::string text(const Score& s) {
  return std::to_string(s.nees) + " NEES, " + std::to_string(s.position_m) + " m, " +
         std::to_string(s.heading_deg) + " deg";
}

Score record(const char* name, const Score& s) {
  testing::Test::RecordProperty(name, text(s));
  return s;
}

TEST(FusionConsistency, SimulatedEstimatorsAreConsistent) {
  const test::TwoOdometries setup;
  EXPECT_NEAR(record("dipo", score(setup, dipo_alone)).nees, 1.0, kHalfWidth);
  EXPECT_NEAR(record("vio", score(setup, vio_alone)).nees, 1.0, kHalfWidth);
}

TEST(FusionConsistency, Eq7DoubleCountsCommonInformation) {
  const Score printed = record("paper", score({}, as_printed));
  EXPECT_GT(printed.nees, 1.0 + 2.0 * kHalfWidth) << text(printed);
}

TEST(FusionConsistency, RelativeFilterIsConsistentAndBetterThanBoth) {
  const test::TwoOdometries setup;
  const Score dipo = score(setup, dipo_alone);
  const Score vio = score(setup, vio_alone);
  const Score fused = record("relative", score(setup, relative(0.0)));
  EXPECT_NEAR(fused.nees, 1.0, kHalfWidth) << text(fused);
  EXPECT_LT(fused.position_m, std::min(dipo.position_m, vio.position_m));
  EXPECT_LT(fused.heading_deg, std::min(dipo.heading_deg, vio.heading_deg));
  record("relative_half_shared", score(setup, relative(0.5)));
  record("relative_default", score(setup, relative(RelativeConfig{}.shared_noise_fraction)));
}

TEST(FusionConsistency, IntersectionIsConservative) {
  const test::TwoOdometries setup;
  const Score crossed = record("intersection", score(setup, intersection));
  EXPECT_LT(crossed.nees, 1.0 + kHalfWidth) << text(crossed);
  EXPECT_GT(crossed.position_m, score(setup, relative(0.0)).position_m);
}

TEST(FusionConsistency, RelativeFilterIsNotOverconfidentWithACommonGyro) {
  test::TwoOdometries setup;
  setup.shared_rotation = 0.7;
  const Score fused =
      record("relative_default", score(setup, relative(RelativeConfig{}.shared_noise_fraction)));
  EXPECT_LT(fused.nees, 1.0 + kHalfWidth) << text(fused);
  record("relative_0", score(setup, relative(0.0)));
  record("relative_1", score(setup, relative(1.0)));
  record("paper", score(setup, as_printed));
  record("intersection", score(setup, intersection));
  record("dipo", score(setup, dipo_alone));
  record("vio", score(setup, vio_alone));
}

}  // namespace
}  // namespace apvi::fusion
