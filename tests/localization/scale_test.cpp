// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <optional>

#include "apvi/geometry/so3.hpp"
#include "geometry/umeyama.hpp"
#include "localization/fusion_stage.hpp"
#include "localization/synchronizer.hpp"
#include "support/simulated_dive.hpp"

namespace apvi::localization {
namespace {

// What the dive has besides its camera.
struct DiveOptions {
  bool imu = false;
  bool dvl = false;
  bool depth = false;
  bool imu_shows_scale = true;
  double bottom_lock_from_s = 0.0;
  double duration_s = 12.0;
};

ActiveSensors sensors_of(const DiveOptions& options) {
  return {.imu = options.imu,
          .dvl = options.imu && options.dvl,
          .dvl_scale = !options.imu && options.dvl,
          .pressure_scale = options.depth && !(options.imu && options.dvl),
          .cameras = 1};
}

class CameraDive {
 public:
  explicit CameraDive(const DiveOptions& options)
      : options_(options),
        sensors_(sensors_of(options)),
        dive_({.duration_s = options.duration_s,
               .gyro_bias = Eigen::Vector3d::Zero(),
               .accel_bias = Eigen::Vector3d::Zero()}),
        synchronizer_({}, test::SimulatedDive::rig(), sensors_),
        stage_(vio_config(options), {}, {}, test::SimulatedDive::rig(), sensors_) {
    for (int k = 0; k < dive_.frames(); ++k) record(k);
  }

  // RMS position error after the best alignment, with scale if asked for [m].
  double error_m(bool with_scale) const {
    std::vector<Eigen::Vector3d> found;
    std::vector<Eigen::Vector3d> truth;
    for (int k = 0; k < dive_.frames(); ++k) {
      const auto pose = path.at(dive_.frame_stamp(k), Duration{1});
      if (!pose) continue;
      found.push_back(pose->translation);
      truth.push_back(dive_.truth(k).p_world);
    }
    const double scale = with_scale ? similarity_scale(found, truth).value() : 1.0;
    for (Eigen::Vector3d& p : found) p *= scale;
    const SE3 T = align_rigid(found, truth).value();
    double sum = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) sum += (T * found[i] - truth[i]).squaredNorm();
    return std::sqrt(sum / static_cast<double>(found.size()));
  }
  std::size_t frames() const { return static_cast<std::size_t>(dive_.frames()); }

  Trajectory path;
  int scales_found = 0;
  std::size_t poses_before_scale = 0;
  bool ends_up_to_scale = false;

 private:
  static vio::Config vio_config(const DiveOptions& options) {
    vio::Config config;
    config.window.max_solve_s = 1e3;
    config.visual.min_parallax_deg = 1.0;  // starts before visual-inertial odometry does
    // The dive accelerates little, which shows the scale to a calibrated IMU only.
    config.initialization_without_dvl.accel_bias_sigma = 0.01;
    config.initialization_without_dvl.pixel_sigma = 0.5;
    if (!options.imu_shows_scale) config.initialization_without_dvl.max_scale_sigma = 1e-4;
    return config;
  }

  void record(int k) {
    const vio::TrackedFrame tracked = dive_.frame(k);
    ImageFrame image;
    image.stamp = tracked.stamp;
    image.decode = [] { return cv::Mat(); };
    process(image, tracked);
    if (options_.depth && k % 2 == 0) {
      PressureDepthSample depth;
      depth.stamp = tracked.stamp;
      depth.depth_m = dive_.depth(tracked.stamp).depth_m;
      process(depth, tracked);
    }
    if (options_.dvl && k % 4 == 0) {
      DvlSample ping;
      ping.stamp = tracked.stamp;
      ping.velocity = dive_.ping(tracked.stamp).velocity;
      ping.valid = k >= options_.bottom_lock_from_s * test::SimulatedDive::kFrameRate;
      process(ping, tracked);
    }
    for (const ImuSample& sample : dive_.imu_until(k)) {
      if (sensors_.imu) process(sample, tracked);
    }
  }

  void process(const SensorEvent& event, const vio::TrackedFrame& tracked) {
    for (const FrameJob& job : synchronizer_.process(event).frames) {
      const FrameOutput output = stage_.process(job, tracked);
      if (output.scale_found) {
        ++scales_found;
        poses_before_scale = path.size();
        apply(*output.scale_found, path);
      }
      path.merge(output.vio.earlier);
      if (const auto pose = output.fused()) path.merge({*pose});
      ends_up_to_scale = output.vio.up_to_scale;
    }
  }

  DiveOptions options_;
  ActiveSensors sensors_;
  test::SimulatedDive dive_;
  Synchronizer synchronizer_;
  FusionStage stage_;
};

TEST(Scale, WithoutAnIMUEveryFrameHasAPoseUpToScale) {
  const CameraDive dive({});
  EXPECT_EQ(dive.path.size(), dive.frames());
  EXPECT_TRUE(dive.ends_up_to_scale);
  EXPECT_EQ(dive.scales_found, 0);
  EXPECT_LT(dive.error_m(true), 0.1);
}

TEST(Scale, PosesUpToScaleBecomeMetricWhenTheIMUShowsTheScale) {
  const CameraDive dive({.imu = true});
  EXPECT_EQ(dive.scales_found, 1);
  EXPECT_GT(dive.poses_before_scale, 3U);
  EXPECT_FALSE(dive.ends_up_to_scale);
  EXPECT_LT(dive.error_m(false), 0.3);  // at its start VIO's scale is a fifth too large here
}

TEST(Scale, PosesUpToScaleBecomeMetricByTheDvlWithoutAnIMU) {
  const CameraDive dive({.dvl = true});
  EXPECT_EQ(dive.scales_found, 1);
  EXPECT_FALSE(dive.ends_up_to_scale);
  EXPECT_LT(dive.error_m(false), 0.15);
}

TEST(Scale, PosesUpToScaleBecomeMetricByTheDepthWithoutAnIMU) {
  const CameraDive dive({.depth = true, .duration_s = 25.0});
  EXPECT_EQ(dive.scales_found, 1);
  EXPECT_FALSE(dive.ends_up_to_scale);
  EXPECT_LT(dive.error_m(false), 0.25);
}

TEST(Scale, PosesUpToScaleBecomeMetricByTheDepthWhenTheIMUDoesNotShowTheScale) {
  const CameraDive dive({.imu = true, .depth = true, .imu_shows_scale = false, .duration_s = 25.0});
  EXPECT_EQ(dive.scales_found, 1);
  EXPECT_FALSE(dive.ends_up_to_scale);
  EXPECT_LT(dive.error_m(false), 0.25);
}

TEST(Scale, PosesStayUpToScaleWithoutBottomLock) {
  const CameraDive dive(
      {.imu = true, .dvl = true, .imu_shows_scale = false, .bottom_lock_from_s = 100.0});
  EXPECT_EQ(dive.scales_found, 0);
  EXPECT_TRUE(dive.ends_up_to_scale);
  EXPECT_GT(dive.path.size(), dive.frames() - 60U);  // all but the first three seconds
}

TEST(Scale, PosesBeforeBottomLockBecomeMetricByTheDvl) {
  const CameraDive dive(
      {.imu = true, .dvl = true, .imu_shows_scale = false, .bottom_lock_from_s = 4.0});
  EXPECT_EQ(dive.scales_found, 1);
  EXPECT_GT(dive.poses_before_scale, 30U);
  EXPECT_FALSE(dive.ends_up_to_scale);
  EXPECT_LT(dive.error_m(false), 0.15);
}

TEST(Scale, TheFirstPoseStaysWhereItIs) {
  const CameraDive dive({.imu = true});
  EXPECT_LT(dive.path.poses.front().T_world_body.translation.norm(), 0.05);
}

}  // namespace
}  // namespace apvi::localization
