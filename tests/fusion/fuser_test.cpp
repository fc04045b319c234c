// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/fuser.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <optional>
#include <set>

#include "fusion/fuser_scene.hpp"
#include "fusion/two_odometries.hpp"
#include "support/matchers.hpp"

namespace apvi::fusion {
namespace {

using test::PoseNear;

TEST(Fuser, AcceptedFrameIsFusedByEq7) {
  Scene scene(as_printed());
  scene.vio_at(0.2);
  const FusionResult result = scene.step();
  EXPECT_EQ(result.state, FusionState::fused);
  EXPECT_TRUE(result.verdict.accepted());
  EXPECT_EQ(result.directions, 6);
  EXPECT_NEAR(result.pose->T_world_body.translation.x(), 0.1, 1e-12);
  EXPECT_NEAR(result.pose->covariance(3, 3), 0.005, 1e-12);
}

TEST(Fuser, StepsOfAlgorithm1AreOrdered) {
  Config config = as_printed();
  config.discriminator.degeneracy.min_position_eigenvalue = 101.0;
  Scene scene(config);  // degenerate, in disagreement, and with few corners
  scene.vio_at(1.0);
  scene.input.statistics = dark();
  EXPECT_EQ(scene.step().verdict.level, Level::coarse);
  scene.input.statistics = rich();
  EXPECT_EQ(scene.step().verdict.level, Level::medium);
  scene.vio_at(0.0);
  const FusionResult result = scene.step();
  EXPECT_EQ(result.verdict.reason, Reason::position_degenerate);
  EXPECT_NEAR(result.verdict.measured, 100.0, 1e-9);
  scene.input.vio->information *= 1.02;
  EXPECT_TRUE(scene.step().verdict.accepted());
}

TEST(Fuser, UsesDipoAndFreezesOnFailureWithStableDipo) {
  Scene scene(as_printed());
  scene.vio_at(0.2);
  scene.step();
  scene.input.statistics = dark();
  const FusionResult result = scene.step();
  EXPECT_EQ(result.state, FusionState::frozen);
  EXPECT_EQ(result.freeze.action, Action::freeze);
  EXPECT_THAT(result.pose->T_world_body, PoseNear(SE3{}, 1e-15));
}

TEST(Fuser, UsesDipoAndDropsOnFailureWithUnstableDipo) {
  Scene scene(as_printed());
  scene.step();
  scene.pings = false;
  for (int i = 0; i < 21; ++i) scene.step();
  scene.input.statistics = dark();
  const FusionResult result = scene.step();
  EXPECT_EQ(result.dipo.reason, StabilityReason::dvl_old);
  EXPECT_EQ(result.state, FusionState::dropped);
  EXPECT_EQ(result.freeze.action, Action::reset);
  EXPECT_THAT(result.pose->T_world_body, PoseNear(SE3{}, 1e-15));
}

TEST(Fuser, UnstableDipoDoesNotRejectVioUnlessAsPrinted) {
  for (const bool printed : {true, false}) {
    Config config = as_printed();
    config.discriminator.agreement.require_stable_dipo = !printed;
    Scene scene(config);
    scene.step();
    scene.pings = false;
    scene.input.dipo->covariance = test::diagonal(1.0, 3.0);
    for (int i = 0; i < 25; ++i) scene.step();
    scene.vio_at(2.0);
    const FusionResult result = scene.step();
    EXPECT_EQ(result.state, printed ? FusionState::dropped : FusionState::fused);
    if (!printed) {
      EXPECT_NEAR(result.pose->T_world_body.translation.x(), 2.0, 0.01);
    }
  }
}

TEST(Fuser, UsesDipoBeforeVioIsInitialized) {
  Scene scene(as_printed());
  scene.input.vio.reset();
  const FusionResult result = scene.step();
  EXPECT_EQ(result.state, FusionState::dipo_only);
  EXPECT_EQ(result.verdict.reason, Reason::no_estimate);
  EXPECT_EQ(result.freeze.phase, Phase::starting);
  EXPECT_EQ(scene.fuser.freeze_policy().counts().failures, 0U);
}

TEST(Fuser, UsesVioWithoutDipo) {
  Scene scene(by_default());
  scene.input.dipo.reset();
  scene.input.vio.reset();
  EXPECT_EQ(scene.step().state, FusionState::waiting);
  EXPECT_FALSE(scene.step().pose);
  scene.input.vio = VioEstimate{};
  scene.input.vio->information = 100.0 * Matrix6::Identity();
  for (int i = 0; i < 3; ++i) {
    scene.vio_at(0.1 * i);
    const FusionResult result = scene.step();
    EXPECT_NEAR(result.pose->T_world_body.translation.x(), 0.1 * i, 1e-12);
    EXPECT_NEAR(result.pose->covariance(3, 3), 0.01, 1e-6);
    EXPECT_EQ(result.state, i == 0 ? FusionState::dropped : FusionState::vio_only);
  }
  scene.input.statistics = dark();
  scene.step();
  const FusionResult failed = scene.step();
  EXPECT_EQ(failed.state, FusionState::dropped);
  EXPECT_EQ(failed.freeze.action, Action::none);  // no better estimate available
  EXPECT_TRUE(failed.pose);
}

TEST(Fuser, InvalidVioIsNotFusedAndResetsTheWindow) {
  for (const int kind : {0, 1, 2, 3}) {
    Scene scene(by_default());
    for (int i = 0; i < 5; ++i) scene.step();
    if (kind == 0) scene.vio_at(NAN);
    if (kind == 1) scene.input.vio->information(2, 2) = INFINITY;
    if (kind == 2) scene.input.vio->healthy = false;
    if (kind == 3) scene.input.vio->window_information = NAN * Matrix6::Ones();
    const FusionResult result = scene.step();
    EXPECT_EQ(result.verdict.reason, Reason::diverged) << kind;
    EXPECT_EQ(result.freeze.action, Action::reset) << kind;
    EXPECT_EQ(result.state, FusionState::dipo_only) << kind;
    EXPECT_THAT(result.pose->T_world_body, PoseNear(SE3{}, 1e-9)) << kind;
  }
}

TEST(Fuser, InvalidDipoIsNotUsed) {
  Scene scene(by_default());
  for (int i = 0; i < 5; ++i) scene.step();
  scene.input.dipo->T_world_body.translation.y() = NAN;
  const FusionResult result = scene.step();
  EXPECT_EQ(result.dipo.reason, StabilityReason::not_finite);
  EXPECT_EQ(result.state, FusionState::vio_only);
  EXPECT_TRUE(is_finite(*result.pose));
  scene.input.dipo->T_world_body.translation.y() = 0.0;
  EXPECT_EQ(scene.step().state, FusionState::fused);
}

TEST(Fuser, RejectsFramesWithBadImageQuality) {
  Scene scene(as_printed());
  scene.input.statistics.quality = vio::FrameQuality::repeated;
  const FusionResult result = scene.step();
  EXPECT_EQ(result.verdict.reason, Reason::no_image);
  EXPECT_EQ(result.verdict.measured, static_cast<double>(vio::FrameQuality::repeated));
}

TEST(Fuser, SingleBadFrameIsNeitherFusedNorFreezes) {
  Config config = as_printed();
  config.hysteresis = {.good_s = 0.2, .bad_s = 0.1};
  Scene scene(config);
  EXPECT_EQ(scene.step().state, FusionState::dipo_only);
  EXPECT_EQ(scene.step().state, FusionState::dipo_only);
  EXPECT_EQ(scene.step().state, FusionState::fused);
  scene.vio_at(0.4);
  const FusionResult bad = scene.step();
  EXPECT_EQ(bad.state, FusionState::dipo_only);
  EXPECT_EQ(bad.freeze.phase, Phase::running);
  EXPECT_THAT(bad.pose->T_world_body, PoseNear(SE3{}, 1e-15));
  scene.vio_at(0.0);
  EXPECT_EQ(scene.step().state, FusionState::fused);
  scene.vio_at(0.4);
  scene.step();
  EXPECT_EQ(scene.step().freeze.action, Action::freeze);
}

TEST(Fuser, ReleasedWindowIsUsedImmediately) {
  Config config = as_printed();
  config.hysteresis = {.good_s = 0.9, .bad_s = 0.0};
  Scene scene(config, {.enabled = true, .release_s = 0.1});
  for (int i = 0; i < 10; ++i) scene.step();
  scene.input.statistics = dark();
  EXPECT_EQ(scene.step().state, FusionState::frozen);
  scene.input.statistics = rich();
  EXPECT_EQ(scene.step().state, FusionState::frozen);
  const FusionResult released = scene.step();
  EXPECT_EQ(released.freeze.action, Action::release);
  EXPECT_EQ(released.state, FusionState::fused);
}

TEST(Fuser, RecoveryNeedsAHigherStableRatio) {
  Config config = as_printed();
  config.hysteresis.recovery_stable_ratio_factor = 1.5;
  Scene scene(config, {.enabled = true, .release_s = 0.0});
  const auto with_share = [&scene](double share) {
    scene.input.statistics = rich();
    scene.input.statistics.stable = static_cast<int>(share * 120.0);
    return scene.step();
  };
  EXPECT_EQ(with_share(0.25).state, FusionState::fused);
  EXPECT_EQ(with_share(0.15).state, FusionState::frozen);
  const FusionResult between = with_share(0.25);
  EXPECT_EQ(between.verdict.reason, Reason::too_few_stable);
  EXPECT_NEAR(between.verdict.threshold, 0.3, 1e-12);
  EXPECT_EQ(with_share(0.31).freeze.action, Action::release);
  EXPECT_EQ(with_share(0.25).state, FusionState::fused);
}

TEST(Fuser, RemappingLeavesDegenerateDirectionsToDipo) {
  Config config = as_printed();
  config.discriminator.degeneracy.min_position_eigenvalue = 50.0;
  config.discriminator.degeneracy.action = DegeneracyAction::remap;
  Scene scene(config);
  scene.input.vio->information(3, 3) = 10.0;  // x
  scene.vio_at(0.2, 0.2);
  const FusionResult result = scene.step();
  EXPECT_EQ(result.state, FusionState::fused);
  EXPECT_EQ(result.directions, 5);
  EXPECT_THAT(result.pose->T_world_body.translation,
              test::MatrixNear(Eigen::Vector3d(0.0, 0.1, 0.0), 1e-12));
  scene.input.vio->information.setZero();
  EXPECT_EQ(scene.step().state,
            FusionState::fused);  // rotation is not tested: three directions remain
  Config strict = config;
  strict.discriminator.degeneracy.min_directions = 4;
  Scene refused(strict);
  refused.input.vio->information.setZero();
  EXPECT_EQ(refused.step().verdict.reason, Reason::position_degenerate);
}

TEST(Fuser, WindowWithoutLandmarksIsDegenerate) {
  Config config = as_printed();
  config.discriminator.degeneracy.min_position_eigenvalue = 50.0;
  Scene scene(config);
  scene.input.vio_includes_dipo = true;
  scene.input.vio->inliers = 1;
  EXPECT_TRUE(scene.step().verdict.accepted());
  scene.input.vio->inliers = 0;
  const FusionResult result = scene.step();
  EXPECT_EQ(result.verdict.level, Level::fine);
  EXPECT_EQ(result.verdict.reason, Reason::no_landmarks);
  EXPECT_EQ(result.directions, 0);
}

TEST(Fuser, FrozenWindowSkipsTheDegeneracyCheck) {
  Config config = as_printed();
  config.discriminator.degeneracy.min_position_eigenvalue = 50.0;
  Scene scene(config, {.release_s = 0.2});
  scene.step();
  scene.input.vio->information *= 0.1;
  EXPECT_EQ(scene.step().verdict.reason, Reason::position_degenerate);
  ASSERT_EQ(scene.fuser.freeze_policy().phase(), Phase::frozen);
  scene.step();
  scene.step();
  EXPECT_EQ(scene.step().freeze.action, Action::release);
}

TEST(Fuser, RemappingSupportsPerInlierThresholds) {
  Config config = as_printed();
  config.discriminator.degeneracy.min_position_eigenvalue = 0.5;
  config.discriminator.degeneracy.normalization = Normalization::per_inlier;
  config.discriminator.degeneracy.action = DegeneracyAction::remap;
  Scene scene(config);
  scene.input.vio->inliers = 100;  // the threshold is 50 in total, the information 100
  EXPECT_EQ(scene.step().directions, 6);
  scene.input.vio->information(3, 3) = 49.0;
  EXPECT_EQ(scene.step().directions, 5);
}

TEST(Fuser, WindowedAgreementAcceptsDriftAndRejectsJumps) {
  Config config = as_printed();
  config.discriminator.agreement.window_s = 2.0;
  Scene scene(config);
  for (int i = 0; i < 100; ++i) {
    scene.vio_at(0.01 * i);  // 1 m in total, 0.2 m in two seconds
    EXPECT_TRUE(scene.step().verdict.accepted()) << i;
  }
  scene.vio_at(1.3);
  EXPECT_EQ(scene.step().verdict.reason, Reason::position_differs);
}

TEST(Fuser, AccumulatedDriftDoesNotPreventRelease) {
  Config config = as_printed();
  config.discriminator.agreement.window_s = 2.0;
  Scene scene(config);
  for (int i = 0; i < 60; ++i) {
    scene.vio_at(0.01 * i);  // 0.6 m in total
    scene.step();
  }
  scene.input.statistics = dark();
  EXPECT_EQ(scene.step().freeze.action, Action::freeze);
  scene.input.statistics = rich();
  EXPECT_TRUE(scene.step().verdict.accepted());
}

TEST(Fuser, ShortDipoInterruptionDoesNotResetTheWindow) {
  Scene scene(by_default());
  for (int i = 0; i < 5; ++i) scene.step();
  scene.input.statistics = dark();
  for (int i = 0; i < 3; ++i) scene.step();
  const auto dipo = std::exchange(scene.input.dipo, std::nullopt);
  EXPECT_EQ(scene.step().freeze.action, Action::none);
  scene.input.dipo = dipo;
  EXPECT_EQ(scene.step().freeze.phase, Phase::frozen);
}

TEST(Fuser, UncertainDipoDoesNotRejectVio) {
  for (const double sigmas : {0.0, 3.0}) {
    Config config = as_printed();
    config.discriminator.agreement.window_s = 2.0;
    config.discriminator.agreement.dipo_sigmas = sigmas;
    Scene scene(config);
    for (int i = 0; i < 10; ++i) scene.step();
    scene.input.dipo->covariance.diagonal().tail<3>().array() += 0.02;  // sigma 0.25 m
    scene.vio_at(0.5);
    EXPECT_EQ(scene.step().verdict.accepted(), sigmas > 0.0);
    scene.vio_at(0.8);
    EXPECT_FALSE(scene.step().verdict.accepted());
  }
}

// Runs a dive through a fuser and measures how the output moves relative to the true motion.
struct Passage {
  double largest_jump_m = 0.0;
  double largest_error_m = 0.0;
  double final_error_m = 0.0;
  std::set<FusionState> states;
};

Passage pass(const Config& config, const std::vector<test::TwoOdometries::Frame>& frames,
             const std::function<bool(double)>& is_dark) {
  Fuser fuser(config, {});
  Passage passage;
  std::optional<Eigen::Vector3d> before;
  for (const auto& frame : frames) {
    FusionInput input;
    input.stamp = Stamp{} + Duration::from_seconds(frame.t);
    input.dipo = frame.dipo;
    input.statistics = is_dark(frame.t) ? dark() : rich();
    if (frame.vio) {
      input.vio = VioEstimate{};
      input.vio->T_world_body = frame.vio->T_world_body;
      input.vio->information = frame.vio->covariance.inverse();
      input.vio->inliers = 80;
    }
    fuser.add({.stamp = input.stamp, .verdict = dipo::Verdict::accepted, .nis = 3.0, .rows = 3});
    const FusionResult result = fuser.update(input);
    const Eigen::Vector3d error = result.pose->T_world_body.translation - frame.truth.translation;
    if (before) passage.largest_jump_m = std::max(passage.largest_jump_m, (error - *before).norm());
    before = error;
    passage.largest_error_m = std::max(passage.largest_error_m, error.norm());
    passage.final_error_m = error.norm();
    passage.states.insert(result.state);
  }
  return passage;
}

TEST(Fuser, OutputHasNoJumpsAtSwitches) {
  const auto is_dark = [](double t) { return std::fmod(t, 10.0) > 7.0; };
  const test::TwoOdometries setup{.speed_bias = 0.02};  // VIO drifts by 0.2 m in ten seconds
  double printed = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto frames = setup.run(seed, 60.0, {{5.0, 100.0}});
    for (const Mode mode : {Mode::paper, Mode::consistent}) {
      Config config = by_default();
      config.mode = mode;
      config.discriminator.agreement.window_s = 0.0;  // these modes re-initialize in the same world
      const Passage passage = pass(config, frames, is_dark);
      EXPECT_TRUE(passage.states.count(FusionState::fused));
      EXPECT_TRUE(passage.states.count(FusionState::frozen));
      // DIPO's noise and corrections are about 3 mm per frame.
      EXPECT_LT(passage.largest_jump_m, 0.04) << seed << ", mode " << static_cast<int>(mode);
    }
    printed = std::max(printed, pass(as_printed(), frames, is_dark).largest_jump_m);
  }
  EXPECT_GT(printed, 0.1);  // without slew limiting the jump is visible
}

TEST(Fuser, BiasedVioCausesBoundedError) {
  // Velocity bias of 0.1 m/s that the covariance of VIO does not include.
  const test::TwoOdometries setup{.speed_bias = 0.1};
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const auto frames = setup.run(seed, 60.0, {{5.0, 100.0}});
    double dipo_error = 0.0;
    for (const auto& frame : frames) {
      dipo_error = std::max(dipo_error,
                            (frame.dipo.T_world_body.translation - frame.truth.translation).norm());
    }
    for (const Mode mode : {Mode::paper, Mode::consistent}) {
      Config config = by_default();
      config.mode = mode;
      const Passage passage = pass(config, frames, [](double) { return false; });
      // VIO is rejected at 30 cm; a fused pose lies between the two.
      EXPECT_LT(passage.largest_error_m, dipo_error + 0.3) << seed;
      EXPECT_TRUE(passage.states.count(FusionState::frozen)) << seed;
    }
  }
}

}  // namespace
}  // namespace apvi::fusion
