// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/depth_queue.hpp"

#include <gtest/gtest.h>

namespace apvi::mapping {
namespace {

TEST(DepthQueue, WaitsForLaterKeyframes) {
  OnlineOptions options;
  options.depth_lag_keyframes = 2;
  DepthQueue queue(options);
  queue.push(5, 1);
  queue.push(6, 2);
  EXPECT_FALSE(queue.due().has_value());
  queue.push(8, 3);
  EXPECT_EQ(queue.due(), 5U);
  queue.pop();
  EXPECT_FALSE(queue.due().has_value());
}

TEST(DepthQueue, TakesEveryNthKeyframe) {
  OnlineOptions options;
  options.depth_every_keyframes = 3;
  DepthQueue queue(options);
  for (std::size_t number = 1; number <= 7; ++number) queue.push(10 * number, number);
  EXPECT_EQ(queue.views(), (std::deque<std::size_t>{30, 60}));
}

TEST(DepthQueue, DropsEverySecondKeyframeOnlyWhenItIsLong) {
  DepthQueue queue{OnlineOptions{}};
  for (std::size_t view = 0; view < 8; ++view) queue.push(view, view + 1);
  queue.thin();
  EXPECT_EQ(queue.size(), 8U);
  queue.push(8, 9);
  queue.thin();
  EXPECT_EQ(queue.views(), (std::deque<std::size_t>{0, 2, 4, 6, 8}));
  queue.remove(4);
  EXPECT_EQ(queue.views(), (std::deque<std::size_t>{0, 2, 6, 8}));
}

}  // namespace
}  // namespace apvi::mapping
