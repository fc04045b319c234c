// SPDX-License-Identifier: BSD-3-Clause
#include "core/text.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace apvi::text {
namespace {

using testing::ElementsAre;

std::vector<std::string_view> parts_of(std::string_view line, char separator = ',') {
  std::vector<std::string_view> parts;
  split(line, separator, parts);
  return parts;
}

TEST(Text, TrimRemovesWhiteSpaceAndCarriageReturns) {
  EXPECT_EQ(trim(" \t a b \r\n"), "a b");
  EXPECT_EQ(trim(" \r\n "), "");
  EXPECT_EQ(trim(""), "");
}

TEST(Text, ByteOrderMarkIsRemovedAtTheStartOnly) {
  EXPECT_EQ(without_byte_order_mark("\xEF\xBB\xBF"
                                    "a"),
            "a");
  EXPECT_EQ(without_byte_order_mark("a\xEF\xBB\xBF"), "a\xEF\xBB\xBF");
  EXPECT_EQ(without_byte_order_mark(""), "");
}

TEST(Text, SplitKeepsEmptyPartsAndTrims) {
  EXPECT_THAT(parts_of("a, b ,c\r"), ElementsAre("a", "b", "c"));
  EXPECT_THAT(parts_of("a,,b"), ElementsAre("a", "", "b"));
  EXPECT_THAT(parts_of("a,"), ElementsAre("a", ""));
  EXPECT_THAT(parts_of(""), ElementsAre(""));
}

TEST(Text, RejectsPartialNumbers) {
  EXPECT_EQ(parse_double("1.5"), 1.5);
  EXPECT_EQ(parse_double(" -2e-3 "), -2e-3);
  EXPECT_EQ(parse_double("+7"), 7.0);
  EXPECT_EQ(parse_int64("-9223372036854775808"), std::numeric_limits<std::int64_t>::min());
  for (const char* bad : {"", " ", "1.5x", "x", "1,5", "1 2", "--1", "+-1", "0x10", "1e"}) {
    EXPECT_FALSE(parse_double(bad)) << bad;
  }
  EXPECT_FALSE(parse_int64("1.0"));
  EXPECT_FALSE(parse_int64("9223372036854775808"));
}

TEST(Text, ParsesNanAndInfinity) {
  EXPECT_TRUE(std::isnan(parse_double("nan").value()));
  EXPECT_EQ(parse_double("-inf"), -HUGE_VAL);
}

TEST(Text, ParsesSecondsAsExactNanoseconds) {
  EXPECT_EQ(parse_seconds_as_ns("1403636580.838555574"), 1403636580838555574);
  EXPECT_EQ(parse_seconds_as_ns("0"), 0);
  EXPECT_EQ(parse_seconds_as_ns("0.1"), 100'000'000);
  EXPECT_EQ(parse_seconds_as_ns("-1.25"), -1'250'000'000);
  EXPECT_EQ(parse_seconds_as_ns("-0.5"), -500'000'000);
  EXPECT_EQ(parse_seconds_as_ns("5."), 5'000'000'000);
  EXPECT_EQ(parse_seconds_as_ns(" 2.000000001\r"), 2'000'000'001);
}

TEST(Text, RoundsDigitsBeyondNanoseconds) {
  EXPECT_EQ(parse_seconds_as_ns("1.0000000004"), 1'000'000'000);
  EXPECT_EQ(parse_seconds_as_ns("1.0000000005"), 1'000'000'001);
  EXPECT_EQ(parse_seconds_as_ns("0.9999999999"), 1'000'000'000);
}

TEST(Text, ParsesSecondsWithExponents) {
  EXPECT_EQ(parse_seconds_as_ns("1.5e1"), 15'000'000'000);
  EXPECT_EQ(parse_seconds_as_ns("-1.5e1"), -15'000'000'000);
  EXPECT_EQ(parse_seconds_as_ns("1.403636580838555574e+09"), 1403636580838555574);
}

TEST(Text, ScalesDecimalsToWholeNumbersExactly) {
  EXPECT_EQ(parse_scaled_int64("1.403636580838555574e18", 0), 1403636580838555574);
  EXPECT_EQ(parse_scaled_int64("1403636580838555574.000000", 0), 1403636580838555574);
  EXPECT_EQ(parse_scaled_int64("1403636580838555.574", 3), 1403636580838555574);
  EXPECT_EQ(parse_scaled_int64("-4e-1", 0), 0);
  EXPECT_EQ(parse_scaled_int64("-5e-1", 0), -1);
  EXPECT_EQ(parse_scaled_int64("0e300", 0), 0);
  EXPECT_EQ(parse_scaled_int64("1e-300", 9), 0);
  for (const char* bad : {"1.8e19", "18446744073709551615", "1e", "e5", "1e+-2", "1e9999"}) {
    EXPECT_FALSE(parse_scaled_int64(bad, 0)) << bad;
  }
}

TEST(Text, RejectsInvalidAndOutOfRangeSeconds) {
  for (const char* bad : {"", "-", ".", "x", "1.2.3", "1-2", "--5", "- 5", "-+5", "nan", "inf",
                          "1e300", "99999999999", "9300000000"}) {
    EXPECT_FALSE(parse_seconds_as_ns(bad)) << bad;
  }
}

TEST(Text, ClosestMatchFindsOnlyTypos) {
  const std::vector<std::string> keys = {"max_features", "min_distance_px", "window"};
  EXPECT_EQ(closest_match("max_feature", keys), "max_features");
  EXPECT_EQ(closest_match("min_distnce_px", keys), "min_distance_px");
  EXPECT_EQ(closest_match("widnow", keys), "window");
  EXPECT_FALSE(closest_match("threads", keys));
  EXPECT_FALSE(closest_match("window", {}));
}

TEST(Text, ToLowerChangesOnlyAsciiLetters) {
  EXPECT_EQ(to_lower("AbC-1_É"), "abc-1_É");
}

}  // namespace
}  // namespace apvi::text
