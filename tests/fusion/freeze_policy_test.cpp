// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/freeze_policy.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace apvi::fusion {
namespace {

const Verdict kGood{};
const Verdict kDark{Level::coarse, Reason::too_few_features, 3.0, 50.0};
const Verdict kNew{Level::coarse, Reason::too_few_stable, 0.1, 0.2};
const Verdict kDiverged{Level::input, Reason::diverged};
const Stability kStable{StabilityReason::stable};
const Stability kOld{StabilityReason::dvl_old, 3.0, 2.0};
const Stability kAbsent{StabilityReason::absent};

// A policy and frames 0.1 s apart; VIO is working if the frame is good.
class Frames {
 public:
  explicit Frames(const FreezeConfig& config = {}) : policy(config) {}
  FreezePolicy::Decision add(const Verdict& verdict, const Stability& dipo = kStable) {
    now = now + Duration::from_seconds(0.1);
    return policy.update(now, verdict.accepted(), verdict, dipo);
  }
  FreezePolicy policy;
  Stamp now;
};

TEST(FreezePolicy, UninitializedVioIsNotAFailure) {
  Frames frames;
  for (int i = 0; i < 5; ++i) EXPECT_EQ(frames.add(kDark).phase, Phase::starting);
  EXPECT_EQ(frames.add(kGood).phase, Phase::running);
  EXPECT_EQ(frames.policy.counts().failures, 0U);
  EXPECT_EQ(frames.policy.counts().freeze_frames, 0U);
}

TEST(FreezePolicy, FailureInTheLastSecondIsNotALackOfRecovery) {
  Frames frames;
  frames.add(kGood);
  EXPECT_TRUE(frames.policy.recovered());
  for (int i = 0; i < 5; ++i) frames.add(kDark);
  EXPECT_TRUE(frames.policy.recovered());
  for (int i = 0; i < 15; ++i) frames.add(kDark);
  EXPECT_FALSE(frames.policy.recovered());
  for (int i = 0; i < 15; ++i) frames.add(kGood);
  EXPECT_TRUE(frames.policy.recovered());
}

TEST(FreezePolicy, FreezesOnceOnFailureWithStableDipo) {
  Frames frames;
  frames.add(kGood);
  const auto decision = frames.add(kDark);
  EXPECT_EQ(decision.action, Action::freeze);
  EXPECT_EQ(decision.phase, Phase::frozen);
  EXPECT_EQ(decision.reason, "too_few_features");
  const auto next = frames.add(kDark);
  EXPECT_EQ(next.action, Action::none);
  EXPECT_EQ(next.phase, Phase::frozen);
  EXPECT_EQ(frames.policy.counts().failures, 1U);
  EXPECT_EQ(frames.policy.counts().freeze_frames, 2U);
}

TEST(FreezePolicy, ReleasesAfterConsecutiveGoodFrames) {
  Frames frames({.enabled = true, .release_s = 0.2});
  frames.add(kGood);
  frames.add(kDark);
  frames.add(kGood);
  frames.add(kGood);
  frames.add(kDark);  // restarts the count
  frames.add(kGood);
  EXPECT_EQ(frames.add(kGood).action, Action::none);
  const auto decision = frames.add(kGood);
  EXPECT_EQ(decision.action, Action::release);
  EXPECT_EQ(decision.phase, Phase::running);
  EXPECT_EQ(frames.add(kGood).action, Action::none);
  EXPECT_EQ(frames.policy.counts().freeze_frames, 6U);  // not counting the frame that releases
}

TEST(FreezePolicy, ReleasesAfterOneFrameIfConfigured) {
  Frames frames({.enabled = true, .release_s = 0.0});
  frames.add(kGood);
  frames.add(kDark);
  EXPECT_EQ(frames.add(kGood).action, Action::release);
}

TEST(FreezePolicy, DropsOnFailureWithUnstableDipo) {
  Frames frames;
  frames.add(kGood);
  const auto decision = frames.add(kDark, kOld);
  EXPECT_EQ(decision.action, Action::reset);
  EXPECT_EQ(decision.phase, Phase::dropped);
  EXPECT_EQ(decision.reason, "DIPO is unstable");
  EXPECT_EQ(frames.policy.counts().drop_frames, 1U);
  EXPECT_EQ(frames.policy.counts().freeze_frames, 0U);
}

TEST(FreezePolicy, DropsAFrozenWindowWhenDipoBecomesUnstable) {
  Frames frames;
  frames.add(kGood);
  frames.add(kDark);
  const auto decision = frames.add(kDark, kOld);
  EXPECT_EQ(decision.action, Action::reset);
  EXPECT_EQ(decision.phase, Phase::dropped);
  EXPECT_EQ(frames.add(kDark, kOld).action, Action::none);  // once
  EXPECT_EQ(frames.policy.counts().resets, 1U);
  EXPECT_EQ(frames.policy.counts().failures, 1U);
}

TEST(FreezePolicy, NeverFreezesADivergedWindow) {
  Frames frames;
  frames.add(kGood);
  EXPECT_EQ(frames.add(kDiverged).action, Action::reset);
  Frames frozen;
  frozen.add(kGood);
  frozen.add(kDark);
  EXPECT_EQ(frozen.add(kDiverged).action, Action::reset);
}

TEST(FreezePolicy, ResetsAfterTheMaximumFreeze) {
  Frames frames({.enabled = true, .release_s = 0.2, .max_frozen_s = 0.25});
  frames.add(kGood);
  frames.add(kDark);
  EXPECT_EQ(frames.add(kDark).action, Action::none);
  EXPECT_EQ(frames.add(kDark).action, Action::none);
  EXPECT_EQ(frames.add(kDark).action, Action::reset);  // 0.3 s after the failure
}

TEST(FreezePolicy, ResetsOnEveryFailureWithFreezingDisabled) {
  Frames frames({.enabled = false, .release_s = 0.1});
  frames.add(kGood);
  const auto decision = frames.add(kDark);
  EXPECT_EQ(decision.action, Action::reset);
  EXPECT_EQ(decision.reason, "freezing is disabled");
  frames.add(kDark);
  frames.add(kGood);
  EXPECT_EQ(frames.add(kGood).phase, Phase::running);
  EXPECT_EQ(frames.policy.counts().freeze_frames, 0U);
  EXPECT_EQ(frames.policy.counts().drop_frames, 3U);
}

TEST(FreezePolicy, KeepsTheWindowWithoutDipo) {
  Frames frames;
  frames.add(kGood, kAbsent);
  const auto decision = frames.add(kDark, kAbsent);
  EXPECT_EQ(decision.action, Action::none);
  EXPECT_EQ(decision.phase, Phase::dropped);
  EXPECT_EQ(frames.policy.counts().failures, 1U);
  frames.add(kGood, kAbsent);
  frames.add(kGood, kAbsent);
  EXPECT_EQ(frames.add(kGood, kAbsent).phase, Phase::running);
}

TEST(FreezePolicy, ReinitTimeStartsAtTheLastReturnOfFeatures) {
  Frames frames({.enabled = true, .release_s = 0.2});
  frames.add(kGood);
  frames.add(kDark);
  frames.add(kNew);   // corners in one frame only
  frames.add(kDark);  // none again
  EXPECT_THAT(frames.policy.reinit_times(), testing::IsEmpty());
  const Stamp back = frames.now + Duration::from_seconds(0.1);
  for (int i = 0; i < 4; ++i) frames.add(kNew);
  for (int i = 0; i < 3; ++i) frames.add(kGood);
  ASSERT_EQ(frames.policy.outages().size(), 1U);
  EXPECT_EQ(frames.policy.outages()[0].features_back, back);
  EXPECT_THAT(frames.policy.reinit_times(), testing::ElementsAre(testing::DoubleNear(0.6, 1e-9)));
}

TEST(FreezePolicy, ReinitTimeStartsAtAFailureWithFeatures) {
  Frames frames({.enabled = true, .release_s = 0.1});
  frames.add(kGood);
  frames.add(kNew);
  frames.add(kGood);
  frames.add(kGood);
  EXPECT_THAT(frames.policy.reinit_times(), testing::ElementsAre(testing::DoubleNear(0.2, 1e-9)));
}

// State after every frame: 'g' a good one, 'b' a bad one, ' ' none.
std::string states(const HysteresisConfig& config, const std::string& frames,
                   double interval_s = 0.1) {
  Hysteresis hysteresis(config);
  std::string seen;
  Stamp now;
  for (const char frame : frames) {
    if (frame == ' ') continue;
    now = now + Duration::from_seconds(interval_s);
    seen += hysteresis.update(now, frame == 'g') ? 'G' : 'B';
  }
  return seen;
}

TEST(Hysteresis, ZeroSecondsSwitchImmediately) {
  EXPECT_EQ(states({.good_s = 0.0, .bad_s = 0.0}, "gbg"), "GBG");
}

TEST(Hysteresis, SwitchesAfterConsecutiveFrames) {
  EXPECT_EQ(states({.good_s = 0.2, .bad_s = 0.1}, "gg b ggg b g bb ggbgg g"), "BBBBBGGGGBBBBBBG");
}

TEST(Hysteresis, SwitchesAfterTheSameTimeAtEveryFrameRate) {
  const HysteresisConfig config{.good_s = 0.19, .bad_s = 0.1};
  EXPECT_EQ(states(config, "gggg", 0.2), "BGGG");
  EXPECT_EQ(states(config, "gggg", 0.1), "BBGG");
  EXPECT_EQ(states(config, "ggggg", 0.05), "BBBBG");
}

}  // namespace
}  // namespace apvi::fusion
