// SPDX-License-Identifier: BSD-3-Clause
#include "core/date_time.hpp"

#include <gtest/gtest.h>

namespace apvi {
namespace {

TEST(ParseDateTime, ReadsIso8601InItsVariants) {
  constexpr std::int64_t kTime_ns = 1'714'567'890'250'000'000;  // 2024-05-01T12:51:30.25Z
  for (const char* text :
       {"2024-05-01T12:51:30.25Z", "2024-05-01 12:51:30.250000", "2024-05-01t12:51:30,25z",
        "2024/05/01 12:51:30.25 UTC", "2024-05-01T14:51:30.25+02:00", "2024-05-01T14:51:30.25+02",
        "2024-05-01T09:21:30.25-0330", "20240501T125130.25Z", " 2024-05-01T12:51:30.25 GMT "}) {
    const auto stamp = parse_date_time(text);
    ASSERT_TRUE(stamp) << text;
    EXPECT_EQ(stamp->ns, kTime_ns) << text;
  }
}

TEST(ParseDateTime, OtherTextsAreNone) {
  for (const char* text :
       {"", "12.5", "1714567890", "2024-05-01", "12:51:30", "01.05.2024 12:51:30",
        "05/01/2024 12:51:30", "2024-05-01 12:51:30 PM", "2024-02-30T00:00:00",
        "2024-05-01T24:00:00", "2024-05-01T12:51", "2024-05-01T12:51:30CEST"}) {
    EXPECT_FALSE(parse_date_time(text)) << text;
  }
}

}  // namespace
}  // namespace apvi
