// SPDX-License-Identifier: BSD-3-Clause
#include "core/interrupt.hpp"

#include <gtest/gtest.h>

#include <csignal>

namespace apvi {
namespace {

TEST(Interrupt, SignalSetsFlag) {
  for (const int signal : {SIGINT, SIGTERM}) {
    const InterruptGuard guard;
    EXPECT_FALSE(guard.interrupted());
    std::raise(signal);
    EXPECT_TRUE(guard.interrupted());
  }
}

TEST(Interrupt, NewGuardClearsFlag) {
  {
    const InterruptGuard guard;
    std::raise(SIGINT);
  }
  const InterruptGuard guard;
  EXPECT_FALSE(guard.interrupted());
}

TEST(InterruptDeathTest, SecondSignalTerminatesProcess) {
  const auto two_signals = [] {
    const InterruptGuard guard;
    std::raise(SIGINT);
    std::raise(SIGINT);
  };
  EXPECT_EXIT(two_signals(), testing::KilledBySignal(SIGINT), "");
}

TEST(InterruptDeathTest, SignalTerminatesProcessWithoutGuard) {
  const auto after_guard = [] {
    { const InterruptGuard guard; }
    std::raise(SIGTERM);
  };
  EXPECT_EXIT(after_guard(), testing::KilledBySignal(SIGTERM), "");
}

}  // namespace
}  // namespace apvi
