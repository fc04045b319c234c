// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/times.hpp"

#include <gtest/gtest.h>

namespace apvi::importer {
namespace {

TEST(ParseTime, ReadsSecondsAndDates) {
  constexpr std::int64_t kTime = 1'714'567'890;  // 2024-05-01T12:51:30Z
  const std::pair<const char*, std::int64_t> times[] = {
      {"1714567890.25", kTime * 1'000'000'000 + 250'000'000},
      {"12.5", 12'500'000'000},
      {"2024-05-01T12:51:30Z", kTime * 1'000'000'000},
      {"2024-05-01 12:51:30.25", kTime * 1'000'000'000 + 250'000'000},
      {"2024-05-01T14:51:30+02:00", kTime * 1'000'000'000},
      {"2024-05-01T09:21:30-0330", kTime * 1'000'000'000}};
  for (const auto& [text, ns] : times) {
    const auto stamp = parse_time(text);
    ASSERT_TRUE(stamp) << text;
    EXPECT_EQ(stamp->ns, ns) << text;
  }
}

TEST(ParseTime, OtherTextsAreNoTime) {
  for (const char* text :
       {"", "noon", "-5", "2024-05-01", "2024-13-01T00:00:00", "2024-05-01T25:00:00",
        "2024-05-01T12:51", "2024-05-01T12:51:30+2", "2024-05-01T12:51:30X"}) {
    EXPECT_FALSE(parse_time(text)) << text;
  }
}

TEST(TimeText, IsADateOnlyForUnixTime) {
  EXPECT_EQ(time_text(Stamp{1'714'567'890'250'000'000}), "2024-05-01T12:51:30.250Z");
  EXPECT_EQ(time_text(Stamp{12'250'000'000}), "12.250 s");
}

}  // namespace
}  // namespace apvi::importer
