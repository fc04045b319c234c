// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/watcher.hpp"

#include <gtest/gtest.h>

namespace apvi::viewer {
namespace {

using std::chrono::milliseconds;

ViewMessage view(std::uint32_t id, bool moving) {
  return {.id = id, .view = {.viewpoint = {.width = 640, .height = 480}}, .moving = moving};
}

class WatcherTest : public testing::Test {
 protected:
  std::optional<FrameJob> frame() {
    const auto job = watcher_.next(now_, version_);
    if (!job) return std::nullopt;
    return std::get<FrameJob>(*job);
  }
  // The frame is drawn, sent and shown at once.
  void show(std::uint32_t frame, double render_s = 0.01) {
    watcher_.sent(frame, render_s, 20000, now_);
    watcher_.written(frame);
    watcher_.receive(DrawnMessage{frame}, now_);
  }

  Watcher watcher_;
  Time now_{std::chrono::seconds(100)};
  std::uint64_t version_ = 1;
};

TEST_F(WatcherTest, NothingIsDrawnBeforeAViewIsAskedFor) {
  EXPECT_FALSE(frame());
}

TEST_F(WatcherTest, AViewAtRestIsDrawnOnceAtFullSize) {
  watcher_.receive(view(4, false), now_);
  const auto job = frame();
  ASSERT_TRUE(job);
  EXPECT_TRUE(job->complete);
  EXPECT_EQ(job->view_id, 4U);
  EXPECT_EQ(job->view.viewpoint.width, 640);
  show(job->frame);
  now_ += milliseconds(5000);
  EXPECT_FALSE(frame());
}

TEST_F(WatcherTest, AMovingViewMayLeaveOutMoreDetailThanOneAtRest) {
  watcher_.receive(view(1, true), now_);
  const auto moving = frame();
  show(moving->frame);
  now_ += milliseconds(200);
  const auto rest = frame();
  ASSERT_TRUE(rest);
  EXPECT_LE(rest->view.detail_px, 1.0);
  EXPECT_LT(rest->view.detail_px, moving->view.detail_px);
}

TEST_F(WatcherTest, OnlyTheNewestViewIsDrawn) {
  for (std::uint32_t id = 0; id < 1000; ++id) watcher_.receive(view(id, true), now_);
  EXPECT_EQ(frame()->view_id, 999U);
  EXPECT_FALSE(frame());
}

TEST_F(WatcherTest, TwoFramesAreUnderWayAtMost) {
  for (std::uint32_t id = 0; id < 2; ++id) {
    watcher_.receive(view(id, true), now_);
    EXPECT_TRUE(frame());
  }
  watcher_.receive(view(2, true), now_);
  EXPECT_FALSE(frame());
  show(1);
  EXPECT_TRUE(frame());
}

TEST_F(WatcherTest, FramesThatWereNotWrittenCannotHaveBeenDrawn) {
  for (std::uint32_t id = 0; id < 3; ++id) {
    watcher_.receive(view(id, true), now_);
    frame();
    watcher_.receive(DrawnMessage{id + 1}, now_);
  }
  watcher_.receive(view(4, true), now_);
  EXPECT_FALSE(frame());
}

TEST_F(WatcherTest, SlowFramesMakeAMovingViewSmallerAndAViewAtRestSharp) {
  for (std::uint32_t id = 0; id < 30; ++id) {
    watcher_.receive(view(id, true), now_);
    const auto job = frame();
    ASSERT_TRUE(job);
    show(job->frame, 0.3 * job->view.viewpoint.width / 640.0);
    now_ += milliseconds(50);
  }
  watcher_.receive(view(30, true), now_);
  const auto moving = frame();
  EXPECT_LT(moving->view.viewpoint.width, 400);
  EXPECT_FALSE(moving->complete);
  show(moving->frame);
  EXPECT_FALSE(frame());
  now_ += milliseconds(200);
  const auto rest = frame();
  ASSERT_TRUE(rest);
  EXPECT_TRUE(rest->complete);
  EXPECT_EQ(rest->view.viewpoint.width, 640);
}

TEST_F(WatcherTest, AViewAtRestIsRenewedWhenTheMapChanges) {
  watcher_.receive(view(1, false), now_);
  show(frame()->frame);
  ++version_;
  EXPECT_FALSE(frame());  // not too often
  now_ += milliseconds(600);
  EXPECT_TRUE(frame());
  EXPECT_FALSE(frame());
}

TEST_F(WatcherTest, AFrameWithoutAMapIsTriedAgainWhenThereIsOne) {
  watcher_.receive(view(1, false), now_);
  watcher_.skipped(frame()->frame);
  now_ += milliseconds(600);
  EXPECT_FALSE(frame());
  ++version_;
  EXPECT_TRUE(frame());
}

TEST_F(WatcherTest, EightRequestsWaitAtMost) {
  for (std::uint32_t id = 0; id < 1000; ++id) {
    watcher_.receive(MeasureMessage{.id = id}, now_);
  }
  int count = 0;
  while (watcher_.next(now_, version_)) ++count;
  EXPECT_EQ(count, 8);
}

}  // namespace
}  // namespace apvi::viewer
