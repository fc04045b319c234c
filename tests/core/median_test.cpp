// SPDX-License-Identifier: BSD-3-Clause
#include "core/median.hpp"

#include <gtest/gtest.h>

#include <cstdint>

namespace apvi {
namespace {

TEST(Median, IsTheMiddleValue) {
  EXPECT_EQ(median<double>({3.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(median<double>({5.0}), 5.0);
  EXPECT_EQ(median<std::int64_t>({9, -4, 7, 7, 0}), 7);
}

TEST(Median, OfAnEvenNumberIsTheUpperMiddleValue) {
  EXPECT_EQ(median<double>({4.0, 1.0, 3.0, 2.0}), 3.0);
}

TEST(Median, OfNothingIsZero) {
  EXPECT_EQ(median<double>({}), 0.0);
}

}  // namespace
}  // namespace apvi
