// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/correction_log.hpp"

#include <gtest/gtest.h>

#include <thread>

namespace apvi::loop_closure {
namespace {

KeyframeCorrections at_second(std::int64_t second) {
  return {{Stamp{second * 1'000'000'000}, SE3::identity()}};
}

std::vector<std::int64_t> seconds_of(const std::vector<KeyframeCorrections>& all) {
  std::vector<std::int64_t> seconds;
  for (const KeyframeCorrections& corrections : all)
    seconds.push_back(corrections.front().stamp.ns / 1'000'000'000);
  return seconds;
}

TEST(CorrectionLog, GivesWhatTheFirstKeyframesCausedOnce) {
  CorrectionLog log;
  log.publish({}, 0);
  log.publish(at_second(2), 1);
  log.publish(at_second(3), 4);
  EXPECT_EQ(seconds_of(log.read(1, false)), std::vector<std::int64_t>{});
  EXPECT_EQ(seconds_of(log.read(2, false)), std::vector<std::int64_t>{2});
  EXPECT_EQ(seconds_of(log.read(2, false)), std::vector<std::int64_t>{});
  log.publish(at_second(4), 4);
  EXPECT_EQ(seconds_of(log.read_all()), (std::vector<std::int64_t>{3, 4}));
  EXPECT_EQ(log.closures(), 4U);
}

TEST(CorrectionLog, KeepsTheLoopsOfAllKeyframes) {
  CorrectionLog log;
  log.publish({}, 0);
  log.publish(at_second(2), 1, {{Stamp{1}, Stamp{2}}});
  log.read_all();
  log.close();
  log.publish({}, 3, {{Stamp{1}, Stamp{3}}, {Stamp{2}, Stamp{3}}});
  ASSERT_EQ(log.loops().size(), 3U);
  EXPECT_EQ(log.loops()[1].from, Stamp{1});
  EXPECT_EQ(log.loops()[2].to, Stamp{3});
}

TEST(CorrectionLog, AReaderWaitsForItsKeyframeAndGetsNoLaterOnes) {
  CorrectionLog log;
  std::thread graph([&log] {
    for (std::int64_t second = 1; second <= 5; ++second) log.publish(at_second(second), 0);
  });
  const auto first = log.read(3, true);
  graph.join();
  EXPECT_EQ(seconds_of(first), (std::vector<std::int64_t>{1, 2, 3}));
}

TEST(CorrectionLog, NoReaderWaitsForAClosedLogWhichKeepsNothingMore) {
  CorrectionLog log;
  log.publish(at_second(1), 0);
  std::thread closes([&log] { log.close(); });
  EXPECT_EQ(seconds_of(log.read(2, true)), std::vector<std::int64_t>{1});
  closes.join();
  log.publish(at_second(2), 3);
  EXPECT_TRUE(log.read_all().empty());
  EXPECT_EQ(log.closures(), 3U);
}

}  // namespace
}  // namespace apvi::loop_closure
