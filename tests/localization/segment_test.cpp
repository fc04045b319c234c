// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "localization/fusion_stage.hpp"
#include "localization/synchronizer.hpp"
#include "support/simulated_dive.hpp"

namespace apvi::localization {
namespace {

constexpr double kDive_s = 24.0;
constexpr int kPauseAt = 240;  // frame

struct Frame {
  int k = 0;  // of the dive
  FrameOutput output;
  bool has_rotation = false;  // since the frame before
};

// A dive with camera, recorded with a pause; the vehicle stays where it is.
class PausedDive {
 public:
  explicit PausedDive(double pause_s)
      : pause_(Duration::from_seconds(pause_s)),
        synchronizer_(dipo_config(), test::SimulatedDive::rig(), {.dvl = true, .cameras = 1}),
        stage_(vio::Config{}, fusion_config(), fusion::FreezeConfig{}, test::SimulatedDive::rig(),
               {.dvl = true, .cameras = 1}) {
    for (int k = 0; k < dive_.frames(); ++k) record(k);
  }

  // With a pose, before or after the pause.
  std::vector<Frame> posed(bool after) const {
    std::vector<Frame> frames;
    for (const Frame& frame : frames_) {
      if ((frame.k >= kPauseAt) == after && frame.output.fusion.pose) frames.push_back(frame);
    }
    return frames;
  }
  // Largest error of the path in the frame of its first pose.
  double shape_error_m(const std::vector<Frame>& path) const {
    double worst = 0.0;
    const SE3 truth = dive_.truth(path.front().k).pose().inverse();
    const SE3 first = path.front().output.fusion.pose->T_world_body.inverse();
    for (const Frame& frame : path) {
      const SE3 moved = first * frame.output.fusion.pose->T_world_body;
      const SE3 true_moved = truth * dive_.truth(frame.k).pose();
      worst = std::max(worst, (moved.translation - true_moved.translation).norm());
    }
    return worst;
  }
  const std::vector<Frame>& frames() const { return frames_; }
  const Synchronizer& synchronizer() const { return synchronizer_; }

 private:
  static dipo::Config dipo_config() {
    dipo::Config config;
    config.initialization.gyro_bias_sigma = 0.1;
    return config;
  }
  // Step 3 has thresholds for real data.
  static fusion::Config fusion_config() {
    fusion::Config config;
    config.discriminator.degeneracy = {.min_rotation_eigenvalue = 0.0,
                                       .min_position_eigenvalue = 0.0};
    return config;
  }
  void record(int k) {
    const Duration later = k >= kPauseAt ? pause_ : Duration{};
    if (k == kPauseAt && pause_.ns > 0) feed_image(dive_.frame_stamp(k) + Duration{pause_.ns / 2});
    vio::TrackedFrame tracked = dive_.frame(k);
    tracked.stamp = dive_.frame_stamp(k) + later;
    tracked_[tracked.stamp] = {k, tracked};
    feed_image(tracked.stamp);
    for (ImuSample sample : dive_.imu_until(k)) {
      sample.stamp = sample.stamp + later;
      feed(sample);
    }
    const vio::PressureDepthMeasurement depth = dive_.depth(dive_.frame_stamp(k));
    feed(PressureDepthSample{tracked.stamp, depth.depth_m});
    if (k % 4 != 0) return;
    DvlSample ping;
    ping.stamp = tracked.stamp;
    ping.velocity = dive_.ping(dive_.frame_stamp(k)).velocity;
    ping.valid = true;
    feed(ping);
  }
  void feed_image(Stamp stamp) {
    ImageFrame image;
    image.stamp = stamp;
    image.decode = [] { return cv::Mat(); };
    feed(image);
  }
  void feed(const SensorEvent& event) {
    for (const FrameJob& job : synchronizer_.process(event).frames) {
      const auto tracked = tracked_.find(job.stamp);
      ASSERT_NE(tracked, tracked_.end()) << "a frame in the gap";
      const auto& [k, frame] = tracked->second;
      frames_.push_back({k, stage_.process(job, frame), job.R_before_now.has_value()});
    }
  }

  Duration pause_;
  test::SimulatedDive dive_{{.seed = 3, .duration_s = kDive_s}};
  Synchronizer synchronizer_;
  FusionStage stage_;
  std::map<Stamp, std::pair<int, vio::TrackedFrame>> tracked_;
  std::vector<Frame> frames_;
};

double sigma_of_x(const Frame& frame) {
  return std::sqrt(frame.output.fusion.pose->covariance(3, 3));
}

std::ptrdiff_t count_fused(const std::vector<Frame>& frames) {
  return std::count_if(frames.begin(), frames.end(), [](const Frame& frame) {
    return frame.output.fusion.state == fusion::FusionState::fused;
  });
}

TEST(FusedSegment, ShapeIsThatOfTheVehicleBeforeAndAfterAPauseOfAnyLength) {
  for (const double pause_s : {5.0, 3600.0, 86400.0}) {
    const PausedDive dive(pause_s);
    const std::vector<Frame> before = dive.posed(false);
    const std::vector<Frame> after = dive.posed(true);
    ASSERT_GT(before.size(), 200U) << pause_s;
    ASSERT_GT(after.size(), 200U) << pause_s;
    EXPECT_LT(dive.shape_error_m(before), 0.25) << pause_s;
    EXPECT_LT(dive.shape_error_m(after), 0.25) << pause_s;
    EXPECT_GT(count_fused(after), 100) << pause_s;  // VIO starts again
    for (const Frame& frame : dive.frames()) {
      EXPECT_NE(frame.output.vio.status, vio::Status::lost) << frame.k;
    }
  }
}

TEST(FusedSegment, PositionContinuesWithTheUncertaintyOfThePause) {
  const PausedDive dive(3600.0);
  const Frame before = dive.posed(false).back();
  const Frame after = dive.posed(true).front();
  const Eigen::Vector3d jump = after.output.fusion.pose->T_world_body.translation -
                               before.output.fusion.pose->T_world_body.translation;
  EXPECT_LT(jump.norm(), 1.0);  // the vehicle moved during initialization
  EXPECT_LT(sigma_of_x(before), 0.5);
  EXPECT_GE(sigma_of_x(after), 7200.0) << "2 m/s";
  EXPECT_LT(std::sqrt(after.output.fusion.pose->covariance(5, 5)), 0.5) << "measured height";
}

TEST(FusedSegment, FramesInThePauseHaveNoPoseAndNoRotationCrossesIt) {
  const PausedDive dive(30.0);
  EXPECT_EQ(dive.synchronizer().abandoned_frames(), 1U);
  for (std::size_t i = 1; i < dive.frames().size(); ++i) {
    EXPECT_EQ(dive.frames()[i].has_rotation, dive.frames()[i].k != kPauseAt) << i;
  }
}

TEST(FusedSegment, AGapUpToTheLimitBeginsNoSegment) {
  const PausedDive dive(0.0);
  const std::vector<Frame> after = dive.posed(true);
  ASSERT_EQ(after.front().k, kPauseAt);
  EXPECT_LT(sigma_of_x(after.front()), 0.5);
}

}  // namespace
}  // namespace apvi::localization
