// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "doctor/log_histogram.hpp"

namespace apvi::doctor {
namespace {

TEST(LogHistogram, ReturnsRepeatedValueExactly) {
  LogHistogram h;
  for (int i = 0; i < 1000; ++i) h.add(0.01);
  EXPECT_NEAR(h.median(), 0.01, 1e-15);
}

TEST(LogHistogram, IsAccurateToOnePercent) {
  LogHistogram h;
  for (int i = 1; i <= 10000; ++i) h.add(i);
  EXPECT_NEAR(h.quantile(0.05), 500.0, 5.0);
  EXPECT_NEAR(h.median(), 5000.0, 50.0);
  EXPECT_NEAR(h.quantile(1.0), 10000.0, 100.0);
  EXPECT_NEAR(h.fraction_at_least(7500.0), 0.25, 0.01);
}

TEST(LogHistogram, AcceptsAnyValue) {
  LogHistogram h;
  EXPECT_EQ(h.median(), 0.0);
  EXPECT_EQ(h.fraction_at_least(1.0), 0.0);
  for (const double value : {0.0, -5.0, std::nan(""), 1e300, 1e-300}) h.add(value);
  EXPECT_EQ(h.count(), 5u);
  EXPECT_LT(h.median(), 1e-9);
  h.add(std::numeric_limits<double>::infinity());
  EXPECT_EQ(h.count(), 6u);
}

}  // namespace
}  // namespace apvi::doctor
