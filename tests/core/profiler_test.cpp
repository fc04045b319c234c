// SPDX-License-Identifier: BSD-3-Clause
#include "core/profiler.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace apvi {
namespace {

void sleep_5_ms() {
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
}

TEST(Profiler, AccumulatesTimeAndCountsNestedScopesForBoth) {
  Profiler profiler;
  EXPECT_EQ(profiler.seconds("work"), 0.0);
  for (int i = 0; i < 2; ++i) {
    const auto work = profiler.scope("work");
    sleep_5_ms();
    const auto part = profiler.scope("nested");
    sleep_5_ms();
  }
  EXPECT_GE(profiler.seconds("work"), 0.020);
  EXPECT_GE(profiler.seconds("nested"), 0.010);
  EXPECT_LT(profiler.seconds("nested"), profiler.seconds("work"));
  EXPECT_EQ(profiler.seconds().size(), 2U);
}

}  // namespace
}  // namespace apvi
