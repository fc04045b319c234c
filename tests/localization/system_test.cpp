// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/localization/system.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "support/simulated_dive.hpp"

namespace apvi::localization {
namespace {

// Four seconds in front of a wall of noise, with IMU and DVL.
class System4s : public testing::Test {
 protected:
  System4s() { cv::randu(wall_, 0, 255); }
  void feed(System& system) {
    test::SimulatedDive dive({.duration_s = 4.0});
    for (int k = 0; k < dive.frames(); ++k) {
      const Stamp stamp = dive.frame_stamp(k);
      system.process(
          ImageFrame{stamp, 0, [this, k] { return wall_(cv::Rect(2 * k, k, 640, 480)).clone(); }});
      for (const ImuSample& sample : dive.imu_until(k)) system.process(sample);
      if (k % 4 != 0) continue;
      DvlSample ping;
      ping.stamp = stamp;
      ping.velocity = dive.ping(stamp).velocity;
      ping.valid = true;
      system.process(ping);
    }
    system.finish();
  }

  cv::Mat wall_ = cv::Mat(600, 900, CV_8UC1);
};

TEST_F(System4s, KeepsTheTrajectoryThatItReports) {
  Trajectory reported;
  System system({}, test::SimulatedDive::rig(),
                {.pose = [&](const StampedPose& pose) { reported.merge({pose}); }});
  feed(system);
  const Trajectory kept = system.trajectory();
  ASSERT_GT(kept.size(), 10U);
  ASSERT_EQ(kept.size(), reported.size());
  EXPECT_EQ(system.pose()->stamp, reported.poses.back().stamp);
}

TEST_F(System4s, HasNoPoseBeforeTheFirstSampleAndAfterAReset) {
  System system({}, test::SimulatedDive::rig());
  EXPECT_FALSE(system.pose());
  feed(system);
  EXPECT_TRUE(system.pose());
  system.reset();
  EXPECT_FALSE(system.pose());
  EXPECT_TRUE(system.trajectory().empty());
}

}  // namespace
}  // namespace apvi::localization
