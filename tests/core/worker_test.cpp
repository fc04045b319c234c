// SPDX-License-Identifier: BSD-3-Clause
#include "core/worker.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <stdexcept>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"

namespace apvi {
namespace {

using namespace std::chrono_literals;

TEST(Worker, ProcessesElementsInOrder) {
  std::vector<int> seen;
  Worker<int> worker(2, Overflow::block, [&](int i) { seen.push_back(i); });
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(worker.push(i));
  worker.wait();
  ASSERT_EQ(seen.size(), 100u);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(seen[static_cast<std::size_t>(i)], i);
}

TEST(Worker, WaitRethrowsExceptionOnce) {
  Worker<int> worker(4, Overflow::block, [](int i) {
    if (i == 3) throw RunError("the third one");
  });
  for (int i = 0; i < 4; ++i) worker.push(i);
  EXPECT_THROW(worker.wait(), RunError);
  EXPECT_NO_THROW(worker.wait());
}

TEST(Worker, PushFailsAfterException) {
  Worker<int> worker(1, Overflow::block, [](int) { throw std::runtime_error("always"); });
  bool accepted = true;
  for (int i = 0; i < 1000 && accepted; ++i) accepted = worker.push(i);
  EXPECT_FALSE(accepted);
  EXPECT_THROW(worker.wait(), std::runtime_error);
}

TEST(Worker, StopDiscardsQueuedElements) {
  std::promise<void> started;
  std::promise<void> release;
  std::shared_future<void> gate = release.get_future().share();
  std::atomic<int> done = 0;
  Worker<int> worker(8, Overflow::block, [&, gate](int i) {
    if (i == 0) started.set_value();
    gate.wait();
    ++done;
  });
  for (int i = 0; i < 8; ++i) worker.push(i);
  started.get_future().wait();
  std::jthread stopper([&] { worker.stop(); });
  std::this_thread::sleep_for(20ms);
  release.set_value();
  stopper.join();
  EXPECT_EQ(done, 1);
  EXPECT_FALSE(worker.push(9));
}

TEST(Worker, CanBeDestroyedWhileBusyOrUnused) {
  {
    const Worker<int> unused(1, Overflow::block, [](int) {});
  }
  std::atomic<int> done = 0;
  {
    Worker<int> busy(1, Overflow::drop_oldest, [&](int) {
      std::this_thread::sleep_for(1ms);
      ++done;
    });
    for (int i = 0; i < 50; ++i) busy.push(i);
  }
  EXPECT_LE(done, 50);
}

TEST(Worker, CountsDroppedElements) {
  std::promise<void> release;
  std::shared_future<void> gate = release.get_future().share();
  std::promise<void> started;
  std::atomic<bool> first = true;
  Worker<int> worker(2, Overflow::drop_oldest, [&, gate](int) {
    if (first.exchange(false)) started.set_value();
    gate.wait();
  });
  worker.push(0);
  started.get_future().wait();
  for (int i = 0; i < 5; ++i) worker.push(i);
  EXPECT_EQ(worker.dropped(), 3u);
  release.set_value();
  worker.wait();
}

}  // namespace
}  // namespace apvi
