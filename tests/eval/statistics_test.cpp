// SPDX-License-Identifier: BSD-3-Clause
#include "eval/statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace apvi::eval {
namespace {

TEST(Statistics, MatchHandComputedValues) {
  const auto s = summarize({4.0, 1.0, 2.0, 5.0});
  ASSERT_TRUE(s.has_value());
  EXPECT_DOUBLE_EQ(s->mean, 3.0);
  EXPECT_DOUBLE_EQ(s->median, 3.0);
  EXPECT_DOUBLE_EQ(s->rmse, std::sqrt(46.0 / 4.0));
  EXPECT_DOUBLE_EQ(s->std, std::sqrt(10.0 / 4.0));  // of the population, not 10 / 3
  EXPECT_EQ(s->min, 1.0);
  EXPECT_EQ(s->max, 5.0);
  EXPECT_EQ(s->count, 4u);
}

TEST(Statistics, MedianOfOddCountIsMiddleValue) {
  EXPECT_EQ(summarize({9.0, 1.0, 2.0})->median, 2.0);
}

TEST(Statistics, SquaredRmseIsSquaredMeanPlusVariance) {
  const auto s = summarize({0.3, 0.1, 7.0, 2.0, 2.5});
  EXPECT_NEAR(s->rmse * s->rmse, s->mean * s->mean + s->std * s->std, 1e-12);
}

TEST(Statistics, StdIsAccurateWithLargeMean) {
  EXPECT_NEAR(summarize({1e8 + 1.0, 1e8 - 1.0})->std, 1.0, 1e-7);
}

TEST(Statistics, AreEmptyForNoErrors) {
  EXPECT_FALSE(summarize({}));
}

}  // namespace
}  // namespace apvi::eval
