// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/tone_curve_evidence.hpp"

#include <gtest/gtest.h>

namespace apvi::mapping {
namespace {

TEST(ToneCurveEvidence, WithoutInformationACameraForViewingIsAssumed) {
  ToneCurveEvidence evidence(ToneCurveOptions{});
  EXPECT_TRUE(evidence.initial().is_linear());
  evidence.add(-1000.0, -995.0);
  EXPECT_EQ(evidence.choice(), kViewingCurve);
  EXPECT_FALSE(evidence.is_decided());
}

TEST(ToneCurveEvidence, AClearlyBetterLinearFitDecides) {
  ToneCurveEvidence evidence(ToneCurveOptions{});
  for (int i = 0; i < 2; ++i) evidence.add(-1000.0, -960.0);
  EXPECT_TRUE(evidence.choice().is_linear());
  EXPECT_FALSE(evidence.is_decided());
  evidence.add(-9000.0, -8000.0);
  EXPECT_TRUE(evidence.is_decided());
}

TEST(ToneCurveEvidence, AGivenCurveIsNeverQuestioned) {
  ToneCurveEvidence evidence({.kind = ToneCurveKind::power, .gamma = 1.8});
  EXPECT_TRUE(evidence.is_decided());
  evidence.add(-9000.0, -1000.0);
  EXPECT_EQ(evidence.choice(), (gaussians::ToneCurve{.gamma = 1.8}));
  EXPECT_EQ(ToneCurveEvidence({.kind = ToneCurveKind::srgb}).initial(), gaussians::kSrgb);
}

}  // namespace
}  // namespace apvi::mapping
