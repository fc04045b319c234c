// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/bounded_queue.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <numeric>
#include <thread>
#include <vector>

namespace apvi {
namespace {

using namespace std::chrono_literals;

TEST(BoundedQueue, IsFirstInFirstOut) {
  BoundedQueue<int> queue(3, Overflow::block);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(queue.push(i));
  for (int i = 0; i < 3; ++i) EXPECT_EQ(queue.pop(), i);
}

TEST(BoundedQueue, DropsOldestAndCountsDrops) {
  BoundedQueue<int> queue(2, Overflow::drop_oldest);
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(queue.push(i));
  EXPECT_EQ(queue.size(), 2u);
  EXPECT_EQ(queue.dropped(), 3u);
  EXPECT_EQ(queue.pop(), 3);
  EXPECT_EQ(queue.pop(), 4);
}

TEST(BoundedQueue, DeliversQueuedElementsAfterClose) {
  BoundedQueue<int> queue(4, Overflow::block);
  queue.push(1);
  queue.push(2);
  queue.close();
  EXPECT_FALSE(queue.push(3));
  EXPECT_EQ(queue.pop(), 1);
  EXPECT_EQ(queue.pop(), 2);
  EXPECT_EQ(queue.pop(), std::nullopt);
}

TEST(BoundedQueue, SupportsMoveOnlyTypes) {
  BoundedQueue<std::unique_ptr<int>> queue(1, Overflow::block);
  queue.push(std::make_unique<int>(7));
  EXPECT_EQ(**queue.pop(), 7);
}

TEST(BoundedQueue, LosesNothingWithManyProducersAndConsumers) {
  constexpr int kEach = 2000;
  constexpr int kThreads = 3;
  BoundedQueue<int> queue(4, Overflow::block);
  std::atomic<long> sum = 0;
  std::vector<std::jthread> consumers;
  for (int c = 0; c < kThreads; ++c) {
    consumers.emplace_back([&] {
      while (const auto value = queue.pop()) sum += *value;
    });
  }
  {
    std::vector<std::jthread> producers;
    for (int p = 0; p < kThreads; ++p) {
      producers.emplace_back([&] {
        for (int i = 1; i <= kEach; ++i) EXPECT_TRUE(queue.push(i));
      });
    }
  }
  queue.close();
  consumers.clear();
  EXPECT_EQ(sum, static_cast<long>(kThreads) * kEach * (kEach + 1) / 2);
  EXPECT_EQ(queue.dropped(), 0u);
}

TEST(BoundedQueue, PushBlocksWhileFull) {
  BoundedQueue<int> queue(1, Overflow::block);
  queue.push(1);
  std::atomic<bool> pushed = false;
  std::jthread producer([&] { pushed = queue.push(2); });
  std::this_thread::sleep_for(20ms);
  EXPECT_FALSE(pushed);
  EXPECT_EQ(queue.pop(), 1);
  producer.join();
  EXPECT_TRUE(pushed);
  EXPECT_EQ(queue.pop(), 2);
}

TEST(BoundedQueue, CloseUnblocksPush) {
  BoundedQueue<int> queue(1, Overflow::block);
  queue.push(1);
  std::atomic<int> result = -1;
  std::jthread producer([&] { result = queue.push(2) ? 1 : 0; });
  std::this_thread::sleep_for(10ms);
  queue.close();
  producer.join();
  EXPECT_EQ(result, 0);
}

TEST(BoundedQueue, StopTokenUnblocksPushAndPop) {
  BoundedQueue<int> empty(1, Overflow::block);
  BoundedQueue<int> full(1, Overflow::block);
  full.push(1);
  std::atomic<int> popped = -1;
  std::atomic<int> pushed = -1;
  std::jthread consumer([&](std::stop_token stop) { popped = empty.pop(stop) ? 1 : 0; });
  std::jthread producer([&](std::stop_token stop) { pushed = full.push(2, stop) ? 1 : 0; });
  std::this_thread::sleep_for(10ms);
  consumer.request_stop();
  producer.request_stop();
  consumer.join();
  producer.join();
  EXPECT_EQ(popped, 0);
  EXPECT_EQ(pushed, 0);
  EXPECT_EQ(full.size(), 1u);
}

TEST(BoundedQueue, RejectsZeroCapacity) {
  EXPECT_THROW(BoundedQueue<int>(0, Overflow::block), std::logic_error);
}

}  // namespace
}  // namespace apvi
