// SPDX-License-Identifier: BSD-3-Clause
#include "core/condition_timer.hpp"

#include <gtest/gtest.h>

namespace apvi {
namespace {

Stamp at(double t_s) {
  return Stamp{} + Duration::from_seconds(t_s);
}

TEST(ConditionTimer, MeasuresFromTheFirstStampOfAnUninterruptedSpan) {
  ConditionTimer timer;
  EXPECT_EQ(timer.update(at(0.0), false), std::nullopt);
  EXPECT_EQ(timer.update(at(1.0), true), 0.0);
  EXPECT_EQ(timer.update(at(1.5), true), 0.5);
  EXPECT_EQ(timer.elapsed(at(3.0)), 2.0);
}

TEST(ConditionTimer, StartsAnewAfterAnInterruptionOrReset) {
  ConditionTimer timer;
  timer.update(at(0.0), true);
  EXPECT_EQ(timer.update(at(1.0), false), std::nullopt);
  EXPECT_EQ(timer.elapsed(at(1.0)), std::nullopt);
  EXPECT_EQ(timer.update(at(2.0), true), 0.0);
  timer.reset();
  EXPECT_EQ(timer.elapsed(at(3.0)), std::nullopt);
  EXPECT_EQ(timer.update(at(4.0), true), 0.0);
}

}  // namespace
}  // namespace apvi
