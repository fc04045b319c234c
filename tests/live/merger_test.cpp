// SPDX-License-Identifier: BSD-3-Clause
#include "live/merger.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace apvi::live {
namespace {

constexpr std::int64_t kMs = 1'000'000;

Stamp at(std::int64_t ms) {
  return Stamp{(100'000 + ms) * kMs};
}
SensorEvent imu(std::int64_t ms) {
  return ImuSample{.stamp = at(ms)};
}
SensorEvent dvl(std::int64_t ms) {
  DvlSample ping;
  ping.stamp = at(ms);
  return ping;
}

// A merger, and what it has delivered: stamps [ms], and the stream's kind.
struct Merged {
  std::vector<std::int64_t> ms;
  std::vector<std::string> kinds;
  Merger merger;

  explicit Merged(const MergerOptions& options = {})
      : merger(options, [this](const SensorEvent& event, Stamp) {
          ms.push_back(stamp_of(event).ns / kMs - 100'000);
          kinds.emplace_back(kind_of(event));
        }) {}
};

TEST(Merger, DeliversAtOnceWhenEveryStreamIsBeyond) {
  Merged m;
  m.merger.add(imu(0), at(1));
  m.merger.add(dvl(0), at(1));
  m.merger.add(imu(10), at(11));
  m.merger.add(dvl(12), at(13));
  EXPECT_EQ(m.ms.back(), 10);
}

TEST(Merger, OrdersSamplesOfALateStream) {
  Merged m;
  // Pings come 50 ms after their stamp; the first one teaches that.
  for (int ms = 0; ms <= 2000; ms += 10) {
    if (ms >= 50 && (ms - 50) % 100 == 0) m.merger.add(dvl(ms - 50), at(ms));
    m.merger.add(imu(ms), at(ms));
  }
  EXPECT_TRUE(std::ranges::is_sorted(m.ms));
  EXPECT_GT(std::ranges::count(m.kinds, "dvl"), 17);
  EXPECT_LE(m.merger.late().contains("dvl") ? m.merger.late().at("dvl") : 0U, 1U);
}

TEST(Merger, WaitsNoLongerThanAStreamTakes) {
  Merged m;
  m.merger.add(dvl(0), at(50));
  m.merger.add(imu(60), at(61));
  m.merger.advance(at(60 + 50));
  EXPECT_TRUE(std::ranges::find(m.ms, 60) == m.ms.end());
  m.merger.advance(at(60 + 56));  // the ping's 50 ms and a margin
  EXPECT_EQ(m.ms.back(), 60);
}

TEST(Merger, ASilentStreamDoesNotHoldTheOthers) {
  Merged m({.max_wait_s = 5.0, .silent_s = 0.5});
  m.merger.add(dvl(-3000), at(0));  // 3 s late: others would wait for that
  m.merger.add(imu(100), at(100));
  EXPECT_NE(m.ms.back(), 100);
  m.merger.advance(at(501));
  EXPECT_EQ(m.ms.back(), 100);
}

TEST(Merger, WaitingIsBounded) {
  Merged m({.max_wait_s = 0.2, .silent_s = 100.0});
  m.merger.add(dvl(-5000), at(0));
  m.merger.add(imu(0), at(1));
  m.merger.advance(at(200));
  EXPECT_NE(m.ms.back(), 0);
  m.merger.advance(at(202));
  EXPECT_EQ(m.ms.back(), 0);
}

TEST(Merger, LateSamplesAreDroppedAndCounted) {
  Merged m;
  for (int ms = 0; ms <= 100; ms += 10) m.merger.add(imu(ms), at(ms));
  m.merger.add(dvl(50), at(101));
  m.merger.finish();
  EXPECT_EQ(m.merger.late().at("dvl"), 1U);
  EXPECT_EQ(std::ranges::count(m.kinds, "dvl"), 0);
  EXPECT_EQ(m.ms.back(), 100);
}

}  // namespace
}  // namespace apvi::live
