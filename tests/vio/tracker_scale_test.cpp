// SPDX-License-Identifier: BSD-3-Clause
// Corner tracking at other image sizes and frame rates.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "sensors/reduced_camera.hpp"
#include "vio/frontend/corner_grid.hpp"
#include "vio/frontend/frame_image.hpp"
#include "vio/frontend/rigidity_check.hpp"
#include "vio/frontend/tracker.hpp"
#include "vio/textured_world.hpp"

namespace apvi::vio {
namespace {

using test::Dive;
using test::frame_stamp;
using test::two_walls;

// A dive whose images are made smaller before they are tracked.
class SmallDive {
 public:
  explicit SmallDive(int by, const TrackerConfig& config = {}) : by_(by), camera_(dive_.camera) {
    camera_.model = reduced(camera_.model, by);
    tracker_ = std::make_unique<Tracker>(config, std::vector{camera_});
  }
  TrackedFrame frame(int k) {
    return tracker_->process({reduced(dive_.image(k), by_)}, frame_stamp(k), dive_.turn(k - 1, k));
  }
  TrackedFrame frames(int count) {
    for (int k = 0; k + 1 < count; ++k) frame(k);
    return frame(count - 1);
  }

 private:
  int by_;
  Dive dive_{two_walls()};
  CameraCalibration camera_;
  std::unique_ptr<Tracker> tracker_;
};

TEST(TrackerScale, CornerDistanceFollowsTheImageSize) {
  const double large = corner_distance({1280, 960}, 150);
  EXPECT_NEAR(large, 49.8, 0.1);
  EXPECT_NEAR(corner_distance({2560, 1920}, 150), 2.0 * large, 1e-9);
  EXPECT_NEAR(corner_distance({1280, 960}, 37), 2.0 * large, 0.7);
  EXPECT_NEAR(corner_distance({160, 120}, 150), 6.25, 0.1);
}

TEST(TrackerScale, CornersOfMediumImagesKeepTheirFlowPatchesApart) {
  for (const cv::Size image : {cv::Size(640, 480), cv::Size(322, 242), cv::Size(320, 240)}) {
    EXPECT_NEAR(corner_distance(image, 150), 25.0, 0.1) << image;
  }
}

TEST(TrackerScale, SmallImagesHaveCornersEnough) {
  SmallDive dive(3);  // 160 x 120
  const FrameStatistics s = dive.frames(6).statistics;
  EXPECT_GT(s.tracked, 90);
  EXPECT_GT(s.tracked + s.detected, 130);
  EXPECT_GT(s.spread, 0.8);
}

TEST(TrackerScale, LargeImagesAreTrackedAtAFractionOfTheirSize) {
  TrackerConfig config;
  config.max_image_side_px = 240;
  Dive large(two_walls(), config);
  SmallDive small(2, config);
  for (int k = 0; k < 4; ++k) {
    const TrackedFrame a = large.frame(k);
    const TrackedFrame b = small.frame(k);
    ASSERT_EQ(a.observations.size(), b.observations.size());
    EXPECT_GT(a.observations.size(), 80U);
    for (std::size_t i = 0; i < a.observations.size(); ++i) {
      EXPECT_EQ(a.observations[i].point, b.observations[i].point);
    }
  }
}

TEST(TrackerScale, PixelsOfReducedImagesAreThoseOfTheRecordedImage) {
  TrackerConfig config;
  config.max_image_side_px = 160;
  Dive dive(two_walls(), config);
  const TrackedFrame frame = dive.frames(0, 3);
  EXPECT_GT(frame.observations.size(), 100U);
  for (const FeatureObservation& o : frame.observations) {
    const auto pixel = dive.camera.model.project(o.point.homogeneous());
    ASSERT_TRUE(pixel);
    EXPECT_LT((*pixel - o.pixel).norm(), 1e-5);
  }
}

TEST(TrackerScale, PyramidReachesAsFarInALargeImageAsInASmallOne) {
  EXPECT_EQ(flow_levels({640, 480}), 3);
  EXPECT_EQ(flow_levels({1280, 720}), flow_levels({640, 480}) + 1);
}

// The age of the oldest tracks when they become stable, at `every`-th frame of 20 Hz.
double age_of_first_stable_track(int every) {
  Dive dive(two_walls());
  for (int k = 0; k < 20; k += every) {
    if (dive.frame(k).statistics.stable > 0) return seconds_between(frame_stamp(0), frame_stamp(k));
  }
  return 0.0;
}

TEST(TrackerScale, TracksAreStableFromAnAgeOnAtEveryFrameRate) {
  EXPECT_DOUBLE_EQ(age_of_first_stable_track(1), 0.4);
  EXPECT_DOUBLE_EQ(age_of_first_stable_track(2), 0.4);
  EXPECT_DOUBLE_EQ(age_of_first_stable_track(4), 0.4);
}

// Whether a point that creeps across the epipolar lines is found out within a second.
bool is_creeping_point_found(double rate_hz) {
  constexpr double kThreshold = 1.0 / 300.0;
  constexpr double kCreep = 0.012;  // per second, on the plane z = 1
  RigidityCheck check(kThreshold);
  for (int k = 0; k <= static_cast<int>(rate_hz); ++k) {
    const double t = k / rate_hz;
    const Stamp stamp{static_cast<std::int64_t>(1e9 * t)};
    std::vector<TrackPoint> points;
    for (int i = 0; i < 40; ++i) {
      const double depth = 2.0 + 0.05 * (i * 7 % 40);
      points.push_back({i, {0.02 * (i % 8) - 0.4 * t / depth, 0.1 * std::floor(i / 8.0)}});
    }
    points[20].point.y() += kCreep * t;
    const auto inlier = check.check(stamp, points, Eigen::Quaterniond::Identity());
    if (inlier[20] == 0) return true;
    check.add(stamp, points);
  }
  return false;
}

TEST(TrackerScale, RigidityIsCheckedOverTheSameTimeAtEveryFrameRate) {
  for (const double rate_hz : {5.0, 10.0, 20.0, 60.0, 120.0}) {
    EXPECT_TRUE(is_creeping_point_found(rate_hz)) << rate_hz;
  }
}

}  // namespace
}  // namespace apvi::vio
