// SPDX-License-Identifier: BSD-3-Clause
// Tracker on faulty camera frames.
#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "vio/textured_world.hpp"

namespace apvi::vio {
namespace {

using test::Dive;
using test::frame_stamp;
using test::two_walls;

std::set<std::int64_t> ids(const TrackedFrame& frame) {
  std::set<std::int64_t> result;
  for (const FeatureObservation& o : frame.observations) result.insert(o.id);
  return result;
}

std::size_t shared(const TrackedFrame& a, const TrackedFrame& b) {
  std::size_t count = 0;
  for (const std::int64_t id : ids(a)) count += ids(b).count(id);
  return count;
}

TEST(TrackerFaults, ReportsRepeatedFramesAndKeepsTrackLengths) {
  Dive dive(two_walls());
  const TrackedFrame third = dive.frames(0, 3);
  const TrackedFrame same_stamp = dive.tracker.process({dive.image(3)}, frame_stamp(2), {});
  EXPECT_EQ(same_stamp.statistics.quality, FrameQuality::repeated);
  EXPECT_TRUE(same_stamp.observations.empty());
  const TrackedFrame same_image =
      dive.tracker.process({dive.image(2)}, frame_stamp(3), dive.turn(2, 3));
  EXPECT_EQ(same_image.statistics.quality, FrameQuality::repeated);
  EXPECT_TRUE(same_image.observations.empty());

  const TrackedFrame next = dive.tracker.process({dive.image(4)}, frame_stamp(4), dive.turn(3, 4));
  EXPECT_GT(shared(third, next), 100U);
  for (const FeatureObservation& o : next.observations) EXPECT_LE(o.track_length, 4);
}

TEST(TrackerFaults, IgnoresOutOfOrderFrames) {
  Dive dive(two_walls());
  const TrackedFrame before = dive.frames(0, 3);
  const TrackedFrame past = dive.tracker.process({dive.image(1)}, frame_stamp(1), {});
  EXPECT_EQ(past.statistics.quality, FrameQuality::out_of_order);
  EXPECT_TRUE(past.observations.empty());
  EXPECT_GT(shared(before, dive.frame(3)), 100U);
}

class TrackerBlackout : public ::testing::TestWithParam<int> {};

TEST_P(TrackerBlackout, ResumesTracksAfterOneUnusableFrame) {
  Dive dive(two_walls());
  const TrackedFrame before = dive.frames(0, 3);
  const TrackedFrame dark = dive.frame(3, cv::Mat(360, 480, CV_8U, cv::Scalar(GetParam())));
  EXPECT_EQ(dark.statistics.quality, FrameQuality::featureless);
  EXPECT_EQ(dark.statistics.tracked, 0);
  EXPECT_TRUE(dark.observations.empty());
  EXPECT_EQ(dark.statistics.brightness, GetParam());
  EXPECT_GT(shared(before, dive.frame(4)), 90U);
}

TEST_P(TrackerBlackout, DropsTracksAfterALongBlackout) {
  Dive dive(two_walls());
  const TrackedFrame before = dive.frames(0, 3);
  for (int k = 3; k < 12; ++k) {
    const TrackedFrame dark = dive.frame(k, cv::Mat(360, 480, CV_8U, cv::Scalar(GetParam())));
    EXPECT_EQ(dark.statistics.quality, FrameQuality::featureless);
  }
  const TrackedFrame after = dive.frame(12);
  EXPECT_EQ(after.statistics.quality, FrameQuality::good);
  EXPECT_EQ(after.statistics.tracked, 0);
  EXPECT_EQ(shared(before, after), 0U);
  EXPECT_GT(dive.frame(13).statistics.tracked, 100);
}

INSTANTIATE_TEST_SUITE_P(BlackAndWhite, TrackerBlackout, ::testing::Values(0, 255));

TEST(TrackerFaults, ResumesTracksAfterAnObstructedFrame) {
  Dive dive(two_walls());
  const TrackedFrame before = dive.frames(0, 4);
  const TrackedFrame covered = dive.frame(4, test::random_texture(512, 99)({0, 0, 480, 360}));
  EXPECT_EQ(covered.statistics.quality, FrameQuality::featureless);
  EXPECT_GT(shared(before, dive.frame(5)), 90U);
}

TEST(TrackerFaults, StartsNewTracksAfterASceneChange) {
  Dive dive(two_walls());
  dive.frames(0, 4);
  Dive elsewhere(two_walls());
  elsewhere.world.texture = test::random_texture(1024, 55);
  int tracked = 0;
  for (int k = 4; k < 14; ++k) tracked = dive.frame(k, elsewhere.image(k)).statistics.tracked;
  EXPECT_GT(tracked, 100);
}

TEST(TrackerFaults, ReportsWrongSizeOrMissingImages) {
  Dive dive(two_walls());
  const TrackedFrame before = dive.frames(0, 3);
  const TrackedFrame small = dive.frame(3, cv::Mat(180, 240, CV_8U, cv::Scalar(7)));
  EXPECT_EQ(small.statistics.quality, FrameQuality::wrong_size);
  const TrackedFrame empty = dive.frame(4, cv::Mat());
  EXPECT_EQ(empty.statistics.quality, FrameQuality::wrong_size);
  EXPECT_TRUE(empty.observations.empty());
  EXPECT_GT(shared(before, dive.frame(5)), 80U);
  const TrackedFrame none = dive.tracker.process({}, frame_stamp(6), {});
  EXPECT_EQ(none.statistics.quality, FrameQuality::wrong_size);
}

TEST(TrackerFaults, ReportsUnsupportedFormats) {
  Dive dive(two_walls());
  int k = 0;
  for (const int type : {CV_8UC2, CV_64F, CV_8S, CV_32S}) {
    const cv::Mat image(360, 480, type, cv::Scalar::all(1));
    EXPECT_EQ(dive.frame(k++, image).statistics.quality, FrameQuality::wrong_size);
  }
}

class TrackerFormats : public ::testing::TestWithParam<int> {};

TEST_P(TrackerFormats, TracksColorAndDeeperFormatsLikeGray) {
  Dive dive(two_walls());
  FrameStatistics s;
  for (int k = 0; k < 4; ++k) {
    cv::Mat image = dive.image(k);
    if (CV_MAT_CN(GetParam()) == 3) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
    if (CV_MAT_CN(GetParam()) == 4) cv::cvtColor(image, image, cv::COLOR_GRAY2BGRA);
    const int depth = CV_MAT_DEPTH(GetParam());
    image.convertTo(image, depth, depth == CV_16U ? 257.0 : (depth == CV_32F ? 1.0 / 255.0 : 1.0));
    s = dive.frame(k, image).statistics;
  }
  EXPECT_EQ(s.quality, FrameQuality::good);
  EXPECT_GT(s.tracked, 110);
}

INSTANTIATE_TEST_SUITE_P(Types, TrackerFormats,
                         ::testing::Values(CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_32FC1));

TEST(TrackerFaults, IgnoresNonFiniteGyroRotations) {
  Dive dive(two_walls());
  dive.frames(0, 3);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const TrackedFrame frame =
      dive.tracker.process({dive.image(3)}, frame_stamp(3), Eigen::Quaterniond(nan, 0.0, 0.0, 0.0));
  EXPECT_GT(frame.statistics.tracked, 100);
  for (const FeatureObservation& o : frame.observations) EXPECT_TRUE(o.point.allFinite());
}

TEST(TrackerFaults, DoesNotKeepReferencesToTheImage) {
  Dive kept(two_walls());
  Dive reused(two_walls());
  cv::Mat buffer;
  for (int k = 0; k < 4; ++k) {
    reused.image(k).copyTo(buffer);
    const TrackedFrame a = reused.frame(k, buffer);
    buffer.setTo(0);
    const TrackedFrame b = kept.frame(k);
    EXPECT_EQ(shared(a, b), a.observations.size());
  }
}

TEST(TrackerFaults, HandlesTinyImages) {
  CameraCalibration camera = test::small_camera();
  camera.model = CameraModel({20.0, 20.0, 10.0, 8.0, Distortion::none, {}, 20, 16});
  Dive dive(two_walls(), {}, camera);
  for (int k = 0; k < 4; ++k) EXPECT_NO_THROW(dive.frame(k));
}

TEST(TrackerFaults, ResetRemovesAllTracks) {
  Dive dive(two_walls());
  const TrackedFrame before = dive.frames(0, 4);
  dive.tracker.reset();
  const TrackedFrame after = dive.tracker.process({dive.image(1)}, frame_stamp(1), {});
  EXPECT_EQ(after.statistics.quality, FrameQuality::good);
  EXPECT_EQ(shared(before, after), 0U);
}

}  // namespace
}  // namespace apvi::vio
