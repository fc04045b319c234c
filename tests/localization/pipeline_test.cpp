// SPDX-License-Identifier: BSD-3-Clause
#include "localization/pipeline.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <opencv2/core.hpp>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/live_sequence.hpp"
#include "apvi/io/tum.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/sensor_monitor.hpp"
#include "localization/synchronizer.hpp"
#include "localization/visual_pipeline.hpp"
#include "support/dive_folder.hpp"
#include "support/simulated_dive.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::localization {
namespace {

// 30 s of IMU, DVL and depth.
class LiveDive : public testing::Test {
 protected:
  LiveDive() {
    test::write_dive(tmp_, "dive", {.duration_s = 30.0});
    io::DatasetConfig dataset;
    dataset.path = (tmp_.path() / "dive").string();
    const auto recording = io::open_sequence(dataset, options_.sensors.use);
    rig_node_ = recording->rig();
    rig_ = make_rig(rig_node_);
    while (auto event = recording->next()) events_.push_back(std::move(*event));
  }
  // A system that appends its poses to `poses_`.
  Pipeline make_pipeline() {
    return {options_,
            rig_,
            select_sensors(options_, rig_, {.images = false}),
            {.pose = [this](const StampedPose& pose) { poses_ += io::tum_line(pose); }}};
  }
  std::string poses_of_all() {
    Pipeline pipeline = make_pipeline();
    for (const SensorEvent& event : events_) pipeline.process(event);
    pipeline.finish();
    return std::exchange(poses_, {});
  }

  test::TmpDir tmp_;
  Options options_;
  config::Node rig_node_;
  Rig rig_;
  std::vector<SensorEvent> events_;
  std::string poses_;
};

TEST_F(LiveDive, LiveSamplesGiveBitIdenticalPosesToRecording) {
  const std::string expected = poses_of_all();
  ASSERT_GT(expected.size(), 1000U);
  Pipeline pipeline = make_pipeline();
  io::LiveSequence live(rig_node_, {.capacity = 8});
  const std::jthread driver([&] {
    for (const SensorEvent& event : events_) live.push(event);
    live.finish();
  });
  while (const auto event = live.next()) pipeline.process(*event);
  pipeline.finish();
  EXPECT_EQ(poses_, expected);
}

TEST_F(LiveDive, ResetRestoresInitialState) {
  const std::string expected = poses_of_all();
  Pipeline pipeline = make_pipeline();
  for (std::size_t i = 0; i < events_.size() / 2; ++i) pipeline.process(events_[i]);
  pipeline.reset();
  poses_.clear();
  EXPECT_FALSE(pipeline.synchronizer().acoustic_odometry().dipo().initialized());
  EXPECT_TRUE(pipeline.sensor_monitor().outages().empty());
  for (const SensorEvent& event : events_) pipeline.process(event);
  pipeline.finish();
  EXPECT_EQ(poses_, expected);
}

TEST_F(LiveDive, DriverErrorIsRethrownToReader) {
  Pipeline pipeline = make_pipeline();
  io::LiveSequence live(rig_node_);
  const std::jthread driver([&] {
    for (const SensorEvent& event : events_) live.push(event);
    live.fail(std::make_exception_ptr(RunError("serial port: no carrier")));
  });
  const auto localize = [&] {
    while (const auto event = live.next()) pipeline.process(*event);
  };
  EXPECT_THROW(localize(), RunError);
  pipeline.finish();
  EXPECT_GT(poses_.size(), 1000U);  // samples before the error were processed
}

// A camera moving past a wall of noise, with IMU and DVL, running on threads.
class Frames : public testing::Test {
 protected:
  Frames() : dive_({.duration_s = 4.0}) {
    options_.run.mode = RunMode::replay;
    cv::randu(wall_, 0, 255);
  }
  Pipeline make_pipeline() {
    return {options_,
            test::SimulatedDive::rig(),
            {.dvl = true, .cameras = 1},
            {.frame = [this](const FrameOutput& output) {
              ++frames_;
              if (frames_ == throw_at_) fail_run("the disk is full");
              stamps_.push_back(output.stamp);
            }}};
  }
  void feed(Pipeline& pipeline, int from, int to) {
    for (int k = from; k < to; ++k) {
      const Stamp stamp = dive_.frame_stamp(k);
      pipeline.process(
          ImageFrame{stamp, 0, [this, k] { return wall_(cv::Rect(2 * k, k, 640, 480)).clone(); }});
      for (const ImuSample& sample : dive_.imu_until(k)) pipeline.process(sample);
      if (k % 4 != 0) continue;
      const vio::DvlMeasurement measured = dive_.ping(stamp);
      DvlSample ping;
      ping.stamp = stamp;
      ping.velocity = measured.velocity;
      ping.valid = true;
      pipeline.process(ping);
    }
  }

  Options options_;
  test::SimulatedDive dive_;
  cv::Mat wall_ = cv::Mat(600, 900, CV_8UC1);
  int frames_ = 0;
  int throw_at_ = 0;
  std::vector<Stamp> stamps_;
};

TEST_F(Frames, OutputsEveryFrameOnceInOrder) {
  Pipeline pipeline = make_pipeline();
  feed(pipeline, 0, 60);
  pipeline.finish();
  EXPECT_GE(frames_, 58);
  EXPECT_TRUE(std::is_sorted(stamps_.begin(), stamps_.end()));
}

TEST_F(Frames, RethrowsStageErrorAndWorksAfterReset) {
  throw_at_ = 20;
  Pipeline pipeline = make_pipeline();
  const auto all = [&] {
    feed(pipeline, 0, 60);
    pipeline.finish();
  };
  EXPECT_THROW(all(), RunError);
  EXPECT_EQ(frames_, 20);
  throw_at_ = 0;
  frames_ = 0;
  pipeline.reset();
  feed(pipeline, 60, 70);
  pipeline.finish();
  EXPECT_GE(frames_, 8);
}

TEST_F(Frames, RethrowsLastStageErrorWhileFeeding) {
  throw_at_ = 5;
  Pipeline pipeline = make_pipeline();
  const auto all = [&] {
    for (int k = 0; k < 120; ++k) {
      feed(pipeline, k, k + 1);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  };
  EXPECT_THROW(all(), RunError);
}

TEST_F(Frames, StopDiscardsQueuedFrames) {
  Pipeline pipeline = make_pipeline();
  feed(pipeline, 0, 40);
  pipeline.stop();
  EXPECT_LE(frames_, 40);
  pipeline.reset();
  const int before = frames_;
  feed(pipeline, 40, 50);
  pipeline.finish();
  EXPECT_GT(frames_, before);
}

TEST(SensorMonitor, ReportsOutageWithBeginAndEnd) {
  SensorMonitor monitor;
  const auto imu_at = [](double s) { return ImuSample{Stamp{} + Duration::from_seconds(s)}; };
  const auto ping_at = [](double s, bool valid) {
    DvlSample ping;
    ping.stamp = Stamp{} + Duration::from_seconds(s);
    ping.valid = valid;
    return ping;
  };
  for (int k = 0; k < 1000; ++k) {
    const double t = 10.0 + 0.01 * k;
    monitor.process(imu_at(t));
    if (k % 20 == 0)
      monitor.process(ping_at(t, k < 300 || k >= 700));  // no bottom lock for four seconds
  }
  ASSERT_EQ(monitor.outages().size(), 1U);
  EXPECT_EQ(monitor.outages()[0].sensor, "dvl");
  EXPECT_NEAR(monitor.outages()[0].since.seconds(), 12.8, 1e-9);
  EXPECT_NEAR(monitor.outages()[0].until->seconds(), 17.0, 1e-9);
}

TEST(SensorMonitor, LowSampleRateIsNotAnOutage) {
  SensorMonitor monitor;
  for (int k = 0; k < 2000; ++k) {
    const Stamp stamp = Stamp{} + Duration::from_seconds(0.01 * k);
    monitor.process(ImuSample{stamp});
    if (k % 200 == 0) monitor.process(PressureDepthSample{stamp, 3.0});
  }
  EXPECT_TRUE(monitor.outages().empty());
}

}  // namespace
}  // namespace apvi::localization
