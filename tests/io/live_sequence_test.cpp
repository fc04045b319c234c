// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/io/live_sequence.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"

namespace apvi::io {
namespace {

using namespace std::chrono_literals;
using Eigen::Vector3d;

constexpr std::int64_t kMs = 1'000'000;

SensorEvent imu(std::int64_t ms) {
  return ImuSample{Stamp{(1000 + ms) * kMs}, Vector3d::Zero(), Vector3d(0.0, 0.0, 9.8)};
}
SensorEvent dvl(std::int64_t ms) {
  DvlSample ping;
  ping.stamp = Stamp{(1000 + ms) * kMs};
  return ping;
}
SensorEvent image(std::int64_t ms, int camera) {
  return ImageFrame{Stamp{(1000 + ms) * kMs}, camera, {}};
}
std::int64_t ms_of(const SensorEvent& event) {
  return stamp_of(event).ns / kMs - 1000;
}
std::vector<std::int64_t> read_all(LiveSequence& live) {
  std::vector<std::int64_t> stamps;
  while (const auto event = live.next()) stamps.push_back(ms_of(*event));
  return stamps;
}

TEST(LiveSequence, DeliversSamplesChronologically) {
  LiveSequence live({});
  live.push(imu(0));
  live.push(imu(10));
  live.push(imu(20));
  live.push(dvl(5));  // late, but within the reorder window
  live.push(image(15, 0));
  live.push(imu(30));
  live.finish();
  EXPECT_EQ(read_all(live), (std::vector<std::int64_t>{0, 5, 10, 15, 20, 30}));
  EXPECT_EQ(live.fraction(), 1.0);
  EXPECT_EQ(live.report().at("imu").delivered, 4U);
  EXPECT_EQ(live.report().at("camera").delivered, 1U);
}

TEST(LiveSequence, HoldsNothingBackWhenStampsAreTrusted) {
  LiveSequence live({}, {.reorder_s = 0.0, .confirm_first = false});
  live.push(imu(0));
  live.push(dvl(1));
  live.push(imu(2));
  live.finish();
  EXPECT_EQ(read_all(live), (std::vector<std::int64_t>{0, 1, 2}));
}

TEST(LiveSequence, DeliversLateSampleOnArrival) {
  LiveSequence live({}, {.reorder_s = 0.02});
  live.push(dvl(-10));
  live.push(dvl(-5));
  for (int ms = 0; ms <= 100; ms += 10) live.push(imu(ms));
  live.push(dvl(5));
  live.push(imu(110));
  live.finish();
  const std::vector<std::int64_t> stamps = read_all(live);
  ASSERT_EQ(stamps.size(), 15U);
  const auto late = std::find(stamps.begin(), stamps.end(), 5);
  ASSERT_NE(late, stamps.begin());
  EXPECT_EQ(*(late - 1), 80);  // reorder window before the newest stamp at arrival
}

TEST(LiveSequence, DropsAndCountsOutOfOrderSamples) {
  LiveSequence live({});
  for (const int ms : {0, 10, 30, 20, 30, 40}) live.push(imu(ms));
  SensorEvent broken = imu(50);
  std::get<ImuSample>(broken).gyro.x() = std::numeric_limits<double>::quiet_NaN();
  live.push(broken);
  live.finish();
  EXPECT_EQ(read_all(live), (std::vector<std::int64_t>{0, 10, 30, 40}));
  const StreamReport& report = live.report().at("imu");
  EXPECT_EQ(report.dropped.at(DropReason::out_of_order), 1U);
  EXPECT_EQ(report.dropped.at(DropReason::duplicate_stamp), 1U);
  EXPECT_EQ(report.dropped.at(DropReason::not_finite), 1U);
}

TEST(LiveSequence, AcceptsEqualStampsOfTwoCameras) {
  LiveSequence live({});
  for (const int ms : {0, 50, 100}) {
    live.push(image(ms, 0));
    live.push(image(ms, 1));
  }
  live.finish();
  EXPECT_EQ(read_all(live).size(), 6U);
}

TEST(LiveSequence, ReportsSensorsOfRigBeforeFirstSample) {
  LiveSequence live(config::parse_yaml("{imu0: {}, cam0: {}}", "rig"));
  EXPECT_TRUE(live.report().contains("camera"));
  EXPECT_FALSE(live.report().contains("dvl"));
}

TEST(LiveSequence, PushBlocksWhileQueueIsFull) {
  LiveSequence live({}, {.capacity = 4, .reorder_s = 0.0});
  std::atomic<int> pushed = 0;
  const std::jthread driver([&] {
    for (int k = 0; k < 200; ++k) {
      live.push(imu(10 * k));
      ++pushed;
    }
    live.finish();
  });
  std::this_thread::sleep_for(50ms);
  EXPECT_LE(pushed.load(), 4);
  EXPECT_EQ(read_all(live).size(), 200U);
}

TEST(LiveSequence, StopUnblocksNext) {
  LiveSequence live({});
  const std::jthread other([&] {
    std::this_thread::sleep_for(30ms);
    live.stop();
  });
  EXPECT_FALSE(live.next());
  EXPECT_FALSE(live.push(imu(0)));
}

TEST(LiveSequence, StopUnblocksPush) {
  LiveSequence live({}, {.capacity = 1});
  std::atomic<bool> refused = false;
  {
    const std::jthread driver([&] {
      while (live.push(imu(0))) {
      }
      refused = true;
    });
    std::this_thread::sleep_for(30ms);
    EXPECT_FALSE(refused);
    live.stop();
  }
  EXPECT_TRUE(refused);
}

TEST(LiveSequence, NextThrowsDriverErrorAfterPushedSamples) {
  LiveSequence live({});
  const std::jthread driver([&] {
    live.push(imu(0));
    live.push(imu(10));
    live.fail(std::make_exception_ptr(RunError("cable disconnected")));
  });
  EXPECT_TRUE(live.next());
  EXPECT_TRUE(live.next());
  EXPECT_THROW(live.next(), RunError);
  EXPECT_FALSE(live.next());
}

TEST(LiveSequence, LosesNothingWithManyDrivers) {
  LiveSequence live({}, {.capacity = 16});
  std::vector<std::jthread> drivers;
  drivers.emplace_back([&] {
    for (int k = 0; k < 2000; ++k) live.push(imu(5 * k));
  });
  drivers.emplace_back([&] {
    for (int k = 0; k < 2000; ++k) live.push(dvl(5 * k));
  });
  std::thread closer([&] {
    drivers.clear();
    live.finish();
  });
  EXPECT_EQ(read_all(live).size(), 4000U);
  closer.join();
}

}  // namespace
}  // namespace apvi::io
