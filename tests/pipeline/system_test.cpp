// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/system.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <opencv2/core.hpp>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/live_sequence.hpp"
#include "apvi/io/tum.hpp"
#include "support/dive_folder.hpp"
#include "support/swim.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::pipeline {
namespace {

// Half a minute on IMU, DVL and depth.
class LiveDive : public testing::Test {
 protected:
  LiveDive() {
    test::write_dive(tmp_, "dive", {.duration_s = 30.0});
    config_.dataset.path = (tmp_.path() / "dive").string();
    const auto recording = io::open_sequence(config_.dataset, config_.sensors.use);
    rig_node_ = recording->rig();
    rig_ = make_rig(rig_node_);
    while (auto event = recording->next()) events_.push_back(std::move(*event));
  }
  // A system that writes its poses into `poses_`.
  System make_system() {
    return {config_,
            rig_,
            find_sensors(config_, rig_, false),
            {.pose = [this](const StampedPose& pose) { poses_ += io::tum_line(pose); }}};
  }
  std::string poses_of_all() {
    System system = make_system();
    for (const SensorEvent& event : events_) system.process(event);
    system.finish();
    return std::exchange(poses_, {});
  }

  test::TmpDir tmp_;
  RunConfig config_;
  config::Node rig_node_;
  Rig rig_;
  std::vector<SensorEvent> events_;
  std::string poses_;
};

TEST_F(LiveDive, SamplesPushedByADriverGiveTheSameBitsAsTheRecording) {
  const std::string expected = poses_of_all();
  ASSERT_GT(expected.size(), 1000U);
  System system = make_system();
  io::LiveSequence live(rig_node_, {.capacity = 8});
  const std::jthread driver([&] {
    for (const SensorEvent& event : events_) live.push(event);
    live.finish();
  });
  while (const auto event = live.next()) system.process(*event);
  system.finish();
  EXPECT_EQ(poses_, expected);
}

TEST_F(LiveDive, AfterAResetItIsAsIfNewlyMade) {
  const std::string expected = poses_of_all();
  System system = make_system();
  for (std::size_t i = 0; i < events_.size() / 2; ++i) system.process(events_[i]);
  system.reset();
  poses_.clear();
  EXPECT_FALSE(system.navigator().localization().dipo().initialized());
  EXPECT_TRUE(system.watch().outages().empty());
  for (const SensorEvent& event : events_) system.process(event);
  system.finish();
  EXPECT_EQ(poses_, expected);
}

TEST_F(LiveDive, ADriversErrorComesOutWhereSamplesAreRead) {
  System system = make_system();
  io::LiveSequence live(rig_node_);
  const std::jthread driver([&] {
    for (const SensorEvent& event : events_) live.push(event);
    live.fail(std::make_exception_ptr(RunError("serial port: no carrier")));
  });
  const auto localize = [&] {
    while (const auto event = live.next()) system.process(*event);
  };
  EXPECT_THROW(localize(), RunError);
  system.finish();
  EXPECT_GT(poses_.size(), 1000U);  // everything before it counts
}

// A camera before a wall of noise that drifts by, with IMU and DVL, on threads.
class Frames : public testing::Test {
 protected:
  Frames() : swim_({.duration_s = 4.0}) {
    config_.run.mode = RunMode::replay;
    cv::randu(wall_, 0, 255);
  }
  System make_system() {
    return {config_,
            test::Swim::rig(),
            {.dvl = true, .cameras = 1},
            {.frame = [this](const FrameOutput& output) {
              ++frames_;
              if (frames_ == throw_at_) fail_run("the disk is full");
              stamps_.push_back(output.stamp);
            }}};
  }
  void feed(System& system, int from, int to) {
    for (int k = from; k < to; ++k) {
      const Stamp stamp = swim_.frame_stamp(k);
      system.process(
          ImageFrame{stamp, 0, [this, k] { return wall_(cv::Rect(2 * k, k, 640, 480)).clone(); }});
      for (const ImuSample& sample : swim_.imu_until(k)) system.process(sample);
      if (k % 4 != 0) continue;
      const vio::DvlMeasurement measured = swim_.ping(stamp);
      DvlSample ping;
      ping.stamp = stamp;
      ping.velocity = measured.velocity;
      ping.valid = true;
      system.process(ping);
    }
  }

  RunConfig config_;
  test::Swim swim_;
  cv::Mat wall_ = cv::Mat(600, 900, CV_8UC1);
  int frames_ = 0;
  int throw_at_ = 0;
  std::vector<Stamp> stamps_;
};

TEST_F(Frames, EveryFrameComesOutOnceAndInOrder) {
  System system = make_system();
  feed(system, 0, 60);
  system.finish();
  EXPECT_GE(frames_, 58);
  EXPECT_TRUE(std::is_sorted(stamps_.begin(), stamps_.end()));
}

TEST_F(Frames, AnErrorOnAStagesThreadComesOutAndEndsNothingElse) {
  throw_at_ = 20;
  System system = make_system();
  const auto all = [&] {
    feed(system, 0, 60);
    system.finish();
  };
  EXPECT_THROW(all(), RunError);
  EXPECT_EQ(frames_, 20);
  throw_at_ = 0;
  frames_ = 0;
  system.reset();
  feed(system, 60, 70);
  system.finish();
  EXPECT_GE(frames_, 8);
}

TEST_F(Frames, AnErrorOfTheLastStageComesOutBeforeTheRecordingEnds) {
  throw_at_ = 5;
  System system = make_system();
  const auto all = [&] {
    for (int k = 0; k < 120; ++k) {
      feed(system, k, k + 1);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  };
  EXPECT_THROW(all(), RunError);
}

TEST_F(Frames, AHardStopAbandonsWhatWaits) {
  System system = make_system();
  feed(system, 0, 40);
  system.stop();
  EXPECT_LE(frames_, 40);
  system.reset();
  const int before = frames_;
  feed(system, 40, 50);
  system.finish();
  EXPECT_GT(frames_, before);
}

TEST(SensorWatch, SaysWhoFellSilentAndWhenItCameBack) {
  SensorWatch watch;
  const auto imu_at = [](double s) { return ImuSample{Stamp{} + Duration::from_seconds(s)}; };
  const auto ping_at = [](double s, bool valid) {
    DvlSample ping;
    ping.stamp = Stamp{} + Duration::from_seconds(s);
    ping.valid = valid;
    return ping;
  };
  for (int k = 0; k < 1000; ++k) {
    const double t = 10.0 + 0.01 * k;
    watch.see(imu_at(t));
    if (k % 20 == 0) watch.see(ping_at(t, k < 300 || k >= 700));  // no lock for four seconds
  }
  ASSERT_EQ(watch.outages().size(), 1U);
  EXPECT_EQ(watch.outages()[0].sensor, "dvl");
  EXPECT_NEAR(watch.outages()[0].since.seconds(), 12.8, 1e-9);
  EXPECT_NEAR(watch.outages()[0].until->seconds(), 17.0, 1e-9);
}

TEST(SensorWatch, ASlowSensorIsNotASilentOne) {
  SensorWatch watch;
  for (int k = 0; k < 2000; ++k) {
    const Stamp stamp = Stamp{} + Duration::from_seconds(0.01 * k);
    watch.see(ImuSample{stamp});
    if (k % 200 == 0) watch.see(DepthSample{stamp, 3.0});
  }
  EXPECT_TRUE(watch.outages().empty());
}

}  // namespace
}  // namespace apvi::pipeline
