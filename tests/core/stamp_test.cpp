// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/stamp.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace apvi {
namespace {

constexpr std::int64_t kEpochNs = 1'746'622'514'367'575'808;

TEST(Stamp, DifferencesAreExactToNanoseconds) {
  const Stamp a{kEpochNs};
  const Stamp b{kEpochNs + 1};
  EXPECT_EQ((b - a).ns, 1);
  EXPECT_EQ(a.seconds(), b.seconds());  // double cannot represent the difference
  EXPECT_DOUBLE_EQ(seconds_between(a, b), 1e-9);
  EXPECT_DOUBLE_EQ(seconds_between(b, a), -1e-9);
}

TEST(Stamp, IsOrdered) {
  EXPECT_LT(Stamp{1}, Stamp{2});
  EXPECT_EQ(Stamp{1} + Duration{1}, Stamp{2});
  EXPECT_EQ(Stamp{2} - Duration{1}, Stamp{1});
  EXPECT_LT(Stamp::min(), Stamp{kEpochNs});
  EXPECT_LT(Stamp{kEpochNs}, Stamp::max());
}

TEST(Duration, RoundsToNearestNanosecond) {
  EXPECT_EQ(Duration::from_seconds(1.5).ns, 1'500'000'000);
  EXPECT_EQ(Duration::from_seconds(0.1).ns, 100'000'000);
  EXPECT_EQ(Duration::from_seconds(-0.1).ns, -100'000'000);
  EXPECT_EQ(Duration::from_seconds(0.6e-9).ns, 1);
  EXPECT_EQ(Duration::from_seconds(-0.6e-9).ns, -1);
}

TEST(Duration, SaturatesOnOverflow) {
  EXPECT_EQ(Duration::from_seconds(1e300).ns, std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(Duration::from_seconds(-HUGE_VAL).ns, std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(Duration::from_seconds(std::nan("")).ns, 0);
}

TEST(Duration, SupportsArithmetic) {
  EXPECT_EQ((Duration{5} + Duration{3}).ns, 8);
  EXPECT_EQ((Duration{5} - Duration{3}).ns, 2);
  EXPECT_EQ((-Duration{5}).ns, -5);
  EXPECT_DOUBLE_EQ(Duration{2'500'000'000}.seconds(), 2.5);
}

}  // namespace
}  // namespace apvi
