// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/timesheet.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace apvi {
namespace {

void rest() {
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
}

TEST(Timesheet, AddsUpWhatAnActivityTakesAndCountsNestedOnesForBoth) {
  Timesheet sheet;
  EXPECT_EQ(sheet.of("work"), 0.0);
  for (int i = 0; i < 2; ++i) {
    const auto work = sheet.enter("work");
    rest();
    const auto part = sheet.enter("part of it");
    rest();
  }
  EXPECT_GE(sheet.of("work"), 0.020);
  EXPECT_GE(sheet.of("part of it"), 0.010);
  EXPECT_LT(sheet.of("part of it"), sheet.of("work"));
  EXPECT_EQ(sheet.seconds().size(), 2U);
}

}  // namespace
}  // namespace apvi
