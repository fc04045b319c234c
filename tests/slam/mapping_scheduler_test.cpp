// SPDX-License-Identifier: BSD-3-Clause
#include "slam/mapping_scheduler.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace apvi::slam {
namespace {

void work(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

TEST(MappingScheduler, GivesEveryKeyframeItsStepsWhenNotInRealTime) {
  const MappingScheduler scheduler({.realtime = false, .steps_per_keyframe = 3});
  EXPECT_TRUE(scheduler.may_step(2, 100));
  EXPECT_FALSE(scheduler.may_step(3, 0));
}

TEST(MappingScheduler, OptimizesWithoutLimitInRealTimeWhileNoFrameWaits) {
  MappingScheduler scheduler({.realtime = true, .steps_per_keyframe = 1});
  scheduler.measure_step([] { work(0.002); });
  EXPECT_TRUE(scheduler.may_step(1000, 0));
}

TEST(MappingScheduler, StopsOptimizingInRealTimeWhenItsShareIsUsedUpAndFramesWait) {
  MappingScheduler scheduler({.realtime = true, .training_fraction = 0.5});
  scheduler.measure_keyframe([] { work(0.002); });
  EXPECT_TRUE(scheduler.may_step(0, 1));
  scheduler.measure_step([] { work(0.02); });
  EXPECT_FALSE(scheduler.may_step(1, 1));
}

TEST(MappingScheduler, SkipsDepthWhenFramesWaitAndDepthHasUsedUpItsShare) {
  MappingScheduler scheduler({.realtime = true, .max_depth_fraction = 0.3});
  scheduler.measure_keyframe([] { work(0.01); });
  EXPECT_TRUE(scheduler.should_skip_depth(1, 0.009));
  EXPECT_FALSE(scheduler.should_skip_depth(1, 0.0));
  EXPECT_FALSE(scheduler.should_skip_depth(0, 0.009));
}

TEST(MappingScheduler, SkipsDepthInRealTimeOnceTheRecordingHasEnded) {
  MappingScheduler realtime({.realtime = true});
  MappingScheduler sequential({.realtime = false});
  realtime.finish();
  sequential.finish();
  EXPECT_TRUE(realtime.should_skip_depth(0, 0.0));
  EXPECT_FALSE(sequential.should_skip_depth(0, 0.0));
}

TEST(MappingScheduler, KeepsThePaceDuringAnOutageWhenNotInRealTime) {
  const MappingScheduler sequential({.realtime = false, .steps_per_keyframe = 3});
  EXPECT_EQ(sequential.outage_steps(4.0, 10.0, 10.0), 12);
  EXPECT_EQ(sequential.outage_steps(4.0, 0.0, 1.0), 0);
  const MappingScheduler realtime({.realtime = true, .steps_per_keyframe = 3});
  EXPECT_EQ(realtime.outage_steps(4.0, 10.0, 10.0), 0);
}

TEST(MappingScheduler, FlushesWithoutTimeLimitOnlyWhenNotInRealTime) {
  const auto steps_after_slow_depth = [](bool realtime) {
    MappingScheduler scheduler(
        {.realtime = realtime, .max_final_s = 1.0, .steps_per_flushed_keyframe = 100});
    scheduler.finish();
    return scheduler.flush_steps(2, 10.0, 10.0, 50.0);
  };
  EXPECT_EQ(steps_after_slow_depth(false), 200);
  EXPECT_EQ(steps_after_slow_depth(true), 0);
}

}  // namespace
}  // namespace apvi::slam
