// SPDX-License-Identifier: BSD-3-Clause
// Corner tracking: accuracy, gyro prediction, exposure, particles, moving objects.
#include "vio/frontend/tracker.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "support/matchers.hpp"
#include "vio/frontend/frame_image.hpp"
#include "vio/textured_world.hpp"

namespace apvi::vio {
namespace {

using test::Dive;
using test::frame_stamp;
using test::swaying_pose;
using test::two_walls;

std::map<std::int64_t, FeatureObservation> by_id(const TrackedFrame& frame, int camera = 0) {
  std::map<std::int64_t, FeatureObservation> result;
  for (const FeatureObservation& o : frame.observations) {
    if (o.camera == camera) result[o.id] = o;
  }
  return result;
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 1e9;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

// Distances between tracked and true positions in the second frame [px].
std::vector<double> errors(const Dive& dive, const TrackedFrame& from, int k_from,
                           const TrackedFrame& to, int k_to) {
  std::vector<double> result;
  const auto before = by_id(from);
  for (const auto& [id, now] : by_id(to)) {
    const auto it = before.find(id);
    if (it == before.end()) continue;
    const auto truth =
        dive.world.seen_again(dive.camera.model, swaying_pose(k_from), it->second.pixel,
                              dive.camera.model, swaying_pose(k_to));
    if (truth) result.push_back((*truth - now.pixel).norm());
  }
  return result;
}

TEST(Tracker, TracksCornersWithSubpixelAccuracyOverTwentyFrames) {
  Dive dive(two_walls());
  const TrackedFrame first = dive.frame(0);
  const TrackedFrame last = dive.frames(1, 21);
  const auto error = errors(dive, first, 0, last, 20);
  EXPECT_GT(error.size(), 50U);
  EXPECT_LT(quantile(error, 0.5), 0.25);
  EXPECT_LT(quantile(error, 0.9), 0.75);
}

TEST(Tracker, TracksNearlyAllVisibleCorners) {
  Dive dive(two_walls());
  dive.frames(0, 5);
  for (int k = 5; k < 15; ++k) {
    const FrameStatistics s = dive.frame(k).statistics;
    EXPECT_EQ(s.quality, FrameQuality::good);
    EXPECT_GT(s.tracked, 110) << k;
    EXPECT_LE(s.tracked + s.detected, 150) << k;
    EXPECT_GT(s.spread, 0.8) << k;
  }
}

TEST(Tracker, PointsAreUndistorted) {
  Dive dive(two_walls());
  for (const FeatureObservation& o : dive.frames(0, 3).observations) {
    const auto pixel = dive.camera.model.project(o.point.homogeneous());
    ASSERT_TRUE(pixel);
    EXPECT_THAT(*pixel, test::MatrixNear(o.pixel, 1e-6));
  }
}

TEST(Tracker, CountsTheFramesOfATrackAlsoAfterDroppedOnes) {
  Dive dive(two_walls());
  const auto before = by_id(dive.frames(0, 4));
  const auto now = by_id(dive.frame(6));  // two frames were dropped
  int compared = 0;
  for (const auto& [id, o] : now) {
    if (before.count(id) == 0) {
      EXPECT_EQ(o.track_length, 1);
      continue;
    }
    ++compared;
    EXPECT_EQ(o.track_length, before.at(id).track_length + 1);
  }
  EXPECT_GT(compared, 100);
}

TEST(Tracker, ObservationsAreSortedAndIdsAreNotReused) {
  Dive dive(two_walls());
  std::set<std::int64_t> ended;
  std::set<std::int64_t> alive;
  for (int k = 0; k < 12; ++k) {
    if (k == 6) dive.tracker.reset();
    std::set<std::int64_t> now;
    std::int64_t last = -1;
    for (const FeatureObservation& o : dive.frame(k).observations) {
      EXPECT_GT(o.id, last);
      EXPECT_EQ(ended.count(o.id), 0U);
      last = o.id;
      now.insert(o.id);
    }
    for (const std::int64_t id : alive) {
      if (now.count(id) == 0) ended.insert(id);
    }
    alive = now;
    EXPECT_FALSE(now.empty());
  }
  EXPECT_FALSE(ended.empty());
}

TEST(Tracker, CountsStableTracks) {
  TrackerConfig config;
  config.stable_s = 0.0;
  config.stable_frames = 4;
  Dive dive(two_walls(), config);
  EXPECT_EQ(dive.frames(0, 3).statistics.stable, 0);
  const TrackedFrame fourth = dive.frame(3);
  const auto long_enough =
      std::count_if(fourth.observations.begin(), fourth.observations.end(),
                    [](const FeatureObservation& o) { return o.track_length >= 4; });
  EXPECT_EQ(fourth.statistics.stable, long_enough);
  EXPECT_GT(fourth.statistics.stable, 80);
}

TEST(Tracker, NewCornersKeepTheMinimumDistance) {
  TrackerConfig config;
  config.min_distance_px = 30.0;
  Dive dive(two_walls(), config);
  const auto observations = dive.frame(0).observations;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    for (std::size_t j = i + 1; j < observations.size(); ++j) {
      EXPECT_GE((observations[i].pixel - observations[j].pixel).norm(), 30.0 - 1e-3);
    }
  }
}

// Fraction of tracks that survive one fast rotation of the camera.
double survivors_of_a_turn(const Eigen::Vector3d& turn, bool gyro) {
  const CameraCalibration camera = test::small_camera();
  const auto world = two_walls();
  const SE3 before;
  const SE3 now{so3::exp(turn), Eigen::Vector3d::Zero()};
  Tracker tracker({}, {camera});
  const TrackedFrame first =
      tracker.process({world.view(camera.model, before)}, frame_stamp(0), {});
  std::optional<Eigen::Quaterniond> R_before_now;
  if (gyro) R_before_now = test::body_turn(camera, before, now);
  const TrackedFrame second =
      tracker.process({world.view(camera.model, now)}, frame_stamp(1), R_before_now);
  return second.statistics.tracked / static_cast<double>(first.observations.size());
}

TEST(Tracker, GyroPredictionKeepsTracksInFastRotation) {
  const Eigen::Vector3d turn(0.05, 0.4, 0.1);  // 23 degrees of yaw per frame
  EXPECT_GT(survivors_of_a_turn(turn, true), 0.4);
  EXPECT_LT(survivors_of_a_turn(turn, false), 0.2);
}

TEST(Tracker, TracksSlowMotionWithoutGyro) {
  EXPECT_GT(survivors_of_a_turn({0.01, 0.03, 0.02}, false), 0.8);
}

TEST(Tracker, ToleratesGyroBias) {
  const CameraCalibration camera = test::small_camera();
  const auto world = two_walls();
  Tracker tracker({}, {camera});
  FrameStatistics s;
  for (int k = 0; k < 15; ++k) {
    std::optional<Eigen::Quaterniond> turn;
    const Eigen::Vector3d bias(0.05, -0.08, 0.06);  // [rad/s]
    if (k > 0) {
      turn = test::body_turn(camera, swaying_pose(k - 1), swaying_pose(k)) * so3::exp(0.05 * bias);
    }
    s = tracker.process({world.view(camera.model, swaying_pose(k))}, frame_stamp(k), turn)
            .statistics;
  }
  EXPECT_GT(s.tracked, 110);
  EXPECT_GT(s.stable, 70);
}

TEST(Tracker, ToleratesExposureChanges) {
  Dive steady(two_walls());
  Dive flickering(two_walls());
  int steady_tracked = 0;
  int flickering_tracked = 0;
  for (int k = 0; k < 12; ++k) {
    cv::Mat image;
    flickering.image(k).convertTo(image, CV_8U, k % 3 == 0 ? 1.0 : (k % 3 == 1 ? 0.6 : 1.6));
    const FrameStatistics s = flickering.frame(k, image).statistics;
    EXPECT_NEAR(s.brightness, cv::mean(image)[0], 1e-6);
    flickering_tracked += s.tracked;
    steady_tracked += steady.frame(k).statistics.tracked;
  }
  EXPECT_GT(flickering_tracked, 0.85 * steady_tracked);
}

// Bright particles that sink and drift independently for a few frames.
cv::Mat with_snow(cv::Mat image, int k) {
  for (int i = 0; i < 250; ++i) {
    Random random(static_cast<std::uint64_t>(1000 + 10'000 * ((k + i) / 6) + i));
    const cv::Point2d start(random.uniform(0.0, image.cols), random.uniform(0.0, image.rows));
    const cv::Point2d velocity(random.uniform(-9.0, 9.0), random.uniform(-9.0, 9.0));
    const double size = random.uniform(1.0, 2.5);
    const cv::Point2d at = start + velocity * ((k + i) % 6);
    cv::circle(image, at * 16, static_cast<int>(16 * size), 230, cv::FILLED, cv::LINE_AA, 4);
  }
  return image;
}

TEST(Tracker, FewStableTracksAreOnMarineSnow) {
  TrackerConfig config;
  config.stable_s = 0.0;
  config.stable_frames = 5;
  Dive dive(two_walls(), config);
  std::vector<TrackedFrame> seen;
  for (int k = 0; k < 20; ++k) seen.push_back(dive.frame(k, with_snow(dive.image(k), k)));
  EXPECT_GT(seen[19].statistics.stable, 30);
  const auto error = errors(dive, seen[15], 15, seen[19], 19);
  EXPECT_GT(error.size(), 30U);
  EXPECT_LT(quantile(error, 0.5), 0.3);
  const auto wrong = std::count_if(error.begin(), error.end(), [](double e) { return e > 3.0; });
  EXPECT_LT(static_cast<double>(wrong), 0.05 * static_cast<double>(error.size()));
}

TEST(Tracker, RejectsMovingObjects) {
  // A third wall that rises by 2 cm per frame while the camera moves sideways.
  auto world = two_walls();
  world.walls.push_back({3.0, -1.2, -0.7, {}});
  Dive dive(world);
  TrackedFrame last;
  for (int k = 0; k < 16; ++k) {
    dive.world.walls[2].shift = {0.0, -0.02 * k};
    last = dive.frame(k);
  }
  int on_it = 0;
  int elsewhere = 0;
  for (const FeatureObservation& o : last.observations) {
    const SE3 pose = swaying_pose(15);
    const auto found = dive.world.hit(pose.translation, pose.rotation * o.point.homogeneous());
    if (!found || o.track_length < 8) continue;
    ++(found->first == 2 ? on_it : elsewhere);
  }
  EXPECT_GT(elsewhere, 100);
  EXPECT_LE(on_it, 3);
}

TEST(Tracker, IsDeterministicAcrossThreadCounts) {
  const int threads = cv::getNumThreads();
  std::vector<std::vector<TrackedFrame>> runs;
  for (const int n : {1, 2, 2}) {
    cv::setNumThreads(n);
    cv::theRNG().state = static_cast<std::uint64_t>(runs.size()) + 5;
    Dive dive(two_walls());
    runs.emplace_back();
    for (int k = 0; k < 8; ++k) {
      runs.back().push_back(dive.tracker.process({dive.image(k)}, frame_stamp(k),
                                                 k % 4 == 3 ? std::nullopt : dive.turn(k - 1, k)));
    }
  }
  cv::setNumThreads(threads);
  for (std::size_t run = 1; run < runs.size(); ++run) {
    for (std::size_t k = 0; k < runs[0].size(); ++k) {
      const auto& a = runs[0][k].observations;
      const auto& b = runs[run][k].observations;
      ASSERT_EQ(a.size(), b.size());
      for (std::size_t i = 0; i < a.size(); ++i) {
        EXPECT_EQ(a[i].id, b[i].id);
        EXPECT_EQ(a[i].pixel, b[i].pixel);
      }
    }
  }
}

TEST(Tracker, FisheyeWithoutInverseAtTheRimGivesFinitePoints) {
  CameraCalibration camera = test::small_camera();
  // The distortion is not invertible near the image corners.
  camera.model = CameraModel(
      {150.0, 150.0, 240.0, 180.0, Distortion::equidistant, {0.0, -0.12, 0.0, 0.0}, 480, 360});
  ASSERT_FALSE(camera.model.unproject({2.0, 2.0}));
  Dive dive(two_walls(), {}, camera);
  for (int k = 0; k < 6; ++k) {
    const TrackedFrame frame = dive.frame(k);
    EXPECT_FALSE(frame.observations.empty());
    for (const FeatureObservation& o : frame.observations) {
      EXPECT_TRUE(o.point.allFinite());
    }
  }
}

TEST(Tracker, SeesNothingThroughTheMask) {
  CameraCalibration camera = test::small_camera();
  const cv::Rect gripper(0, 240, 480, 120);
  camera.mask = cv::Mat(360, 480, CV_8U, cv::Scalar(255));
  camera.mask(gripper).setTo(0);
  const cv::Mat overlay = test::random_texture(480, 3);
  Dive dive(two_walls(), {}, camera);
  for (int k = 0; k < 15; ++k) {
    cv::Mat image = dive.image(k);
    overlay(cv::Rect(0, 0, 480, 120)).copyTo(image(gripper));
    const TrackedFrame frame = dive.frame(k, image);
    EXPECT_GT(frame.observations.size(), 70U) << k;
    for (const FeatureObservation& o : frame.observations) {
      EXPECT_LT(o.pixel.y(), 240 - kFlowWindow / 2) << k;
    }
  }
}

TEST(Tracker, AMaskDoesNotMakeADarkImageBright) {
  CameraCalibration camera = test::small_camera();
  camera.mask = cv::Mat(360, 480, CV_8U, cv::Scalar(255));
  camera.mask.rowRange(300, 360).setTo(0);
  Dive dive(two_walls(), {}, camera);
  cv::Mat image(360, 480, CV_8U, cv::Scalar(0));
  image.rowRange(300, 360).setTo(255);
  const FrameStatistics statistics = dive.frame(0, image).statistics;
  EXPECT_EQ(statistics.quality, FrameQuality::featureless);
  EXPECT_EQ(statistics.brightness, 0.0);
}

}  // namespace
}  // namespace apvi::vio
