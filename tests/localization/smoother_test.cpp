// SPDX-License-Identifier: BSD-3-Clause
#include "localization/smoother.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>

#include "apvi/geometry/so3.hpp"
#include "support/simulated_dive.hpp"
#include "support/textured_floor.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::localization {
namespace {

constexpr int kLap = 100;                // frames per lap
constexpr int kFrames = 2 * kLap;        // two laps
constexpr double kPeriod_s = 0.5;        // of the frames
constexpr double kTurn = 4e-4;           // heading drift per frame [rad]
constexpr double kSigmaPerFrame = 1e-3;  // of the odometry, as reported [m, rad]

Stamp stamp_of(int frame) {
  return Stamp{} + Duration::from_seconds(kPeriod_s * frame);
}

Rig floor_rig() {
  Rig rig;
  CameraCalibration camera;
  camera.model = test::floor_camera();
  camera.T_body_camera = {Eigen::Quaterniond::Identity(), {0.1, 0.0, 0.0}};
  rig.cameras.push_back(camera);
  return rig;
}

SE3 truth(int frame) {
  const double a = 2.0 * M_PI * frame / kLap;
  return test::camera_looking_down({3.0 * std::cos(a), 3.0 * std::sin(a), 2.0}, a);
}

SE3 odometry(int frame) {
  Eigen::Vector3d p = truth(0).translation;
  for (int k = 0; k < frame; ++k) {
    p += so3::exp({0.0, 0.0, kTurn * k}) * (truth(k + 1).translation - truth(k).translation);
  }
  return {so3::exp({0.0, 0.0, kTurn * frame}) * truth(frame).rotation, p};
}

/// A frame of a visual-inertial odometry with a window of one second, the newest frame fixed.
FrameOutput output_of(int frame) {
  FrameOutput output;
  output.stamp = stamp_of(frame);
  output.vio.status = vio::Status::tracking;
  output.vio.window_s = 1.0;
  const double variance = kSigmaPerFrame * kSigmaPerFrame / kPeriod_s;
  output.vio.window_information = fusion::Matrix6::Identity() / variance;
  const SE3 pose = odometry(frame);
  output.vio.state.R_world_body = pose.rotation;
  output.vio.state.p_world = pose.translation;
  output.fusion.state = fusion::FusionState::vio_only;
  output.fusion.pose = fusion::PoseEstimate{pose, fusion::Matrix6::Identity() * 1e-4};
  return output;
}

MapFrame map_frame_of(int frame, const Rig& rig) {
  MapFrame news;
  news.stamp = news.image_stamp = stamp_of(frame);
  news.T_world_body = odometry(frame);
  news.image = test::render_floor(truth(frame) * rig.cameras.front().T_body_camera);
  for (int k = std::max(0, frame - 5); k < frame; ++k) {
    news.window.push_back({stamp_of(k), odometry(k)});
  }
  return news;
}

/// A map that consists of the poses of its keyframes.
class MapOfPoses {
 public:
  void add(const MapFrame& news) {
    log_ = news.corrections;
    for (const auto& corrections : log_->read(news.graph_keyframes, true)) correct(corrections);
    for (const StampedPose& pose : news.window) {
      if (const auto known = keyframes_.find(pose.stamp); known != keyframes_.end())
        known->second.odometry = pose.T_world_body;
    }
    keyframes_[news.stamp] = {.odometry = news.T_world_body, .correction = newest_};
  }
  void finish() {
    for (const auto& corrections : log_->read_all()) correct(corrections);
  }
  SE3 pose(Stamp stamp) const {
    const Keyframe& keyframe = keyframes_.at(stamp);
    return keyframe.correction * keyframe.odometry;
  }
  bool has(Stamp stamp) const { return keyframes_.contains(stamp); }

 private:
  struct Keyframe {
    SE3 odometry;
    SE3 correction;
  };

  void correct(const loop_closure::KeyframeCorrections& corrections) {
    for (const auto& [stamp, motion] : corrections) {
      const auto known = keyframes_.find(stamp);
      if (known != keyframes_.end()) known->second.correction = motion * known->second.correction;
    }
    newest_ = corrections.back().T_after_before * newest_;
  }

  std::map<Stamp, Keyframe> keyframes_;
  SE3 newest_;
  std::shared_ptr<loop_closure::CorrectionLog> log_;
};

struct Result {
  Trajectory odometry;
  Trajectory smoothed;
  MapOfPoses map;
  loop_closure::PlaceMap places;
  bool found = false;
  SE3 T_map_odom;
  std::size_t closures = 0;
};

/// `from` to `to`: frames without a usable image, which VIO bridges or, if `restarts`, does not.
Result dive(const Options& options, int from = 0, int to = 0, bool restarts = false) {
  const Rig rig = floor_rig();
  Smoother smoother(options, rig, {.cameras = 1}, true);
  Result result;
  for (int frame = 0; frame < kFrames; ++frame) {
    const FrameOutput output = output_of(frame);
    result.odometry.poses.push_back(*output.fused());
    const bool dark = frame >= from && frame < to;
    std::optional<MapFrame> news;
    if (!dark) news = map_frame_of(frame, rig);
    if (restarts && frame == to) news->window.clear();
    smoother.add(output, {}, news);
    if (!news) continue;
    smoother.connect(*news);
    result.map.add(*news);
  }
  smoother.finish();
  result.map.finish();
  result.smoothed = smoother.smoothed(result.odometry);
  result.T_map_odom = smoother.T_map_odom();
  result.closures = smoother.closer().closures();
  result.places = smoother.closer().place_map();
  const loop_closure::MapAnchors* anchors = smoother.closer().anchors();
  result.found = anchors != nullptr && anchors->found();
  return result;
}

bool is_same(const SE3& a, const SE3& b) {
  return a.translation == b.translation && a.rotation.coeffs() == b.rotation.coeffs();
}

double largest_error(const Trajectory& poses) {
  double largest = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    largest = std::max(
        largest,
        (poses.poses[i].T_world_body.translation - truth(static_cast<int>(i)).translation).norm());
  }
  return largest;
}

/// That a map which follows the corrections lies on the smoothed trajectory.
void expect_map_on_trajectory(const Result& result) {
  constexpr double kUnreported_m = 2e-3;  // of smaller corrections
  std::size_t keyframes = 0;
  for (const StampedPose& pose : result.smoothed.poses) {
    if (!result.map.has(pose.stamp)) continue;
    const SE3 difference = result.map.pose(pose.stamp).inverse() * pose.T_world_body;
    EXPECT_LT(difference.translation.norm(), kUnreported_m) << pose.stamp.ns;
    ++keyframes;
  }
  EXPECT_GT(keyframes, 100U);
}

TEST(Smoother, ClosesTheLoopOfADriftedTrajectory) {
  const Result result = dive({});
  EXPECT_GT(result.closures, 10U);
  ASSERT_EQ(result.smoothed.size(), result.odometry.size());
  ASSERT_GT(largest_error(result.odometry), 0.2);
  EXPECT_LT(largest_error(result.smoothed), 0.3 * largest_error(result.odometry));
  expect_map_on_trajectory(result);
  const SE3 newest = result.T_map_odom * result.odometry.poses.back().T_world_body;
  const SE3& last = result.smoothed.poses.back().T_world_body;
  EXPECT_LT((newest.translation - last.translation).norm(), 1e-9);
  EXPECT_LT(so3::angle_between(newest.rotation, last.rotation), 1e-9);
}

// Odometry begins anew at a wrong pose, with VIO alone: its covariance says nothing about the gap.
TEST(Smoother, APathWithoutOdometryInBetweenIsFoundAgain) {
  constexpr int kLost = 120;
  constexpr int kResumed = 150;  // over places of the first lap
  const SE3 unseen{so3::exp({0.0, 0.0, 1.5}), {4.0, -2.0, 0.5}};
  const Rig rig = floor_rig();
  Smoother smoother({}, rig, {.cameras = 1}, false);
  Trajectory odometry;
  Trajectory expected;
  for (int frame = 0; frame < kFrames; ++frame) {
    if (frame >= kLost && frame < kResumed) continue;
    FrameOutput output = output_of(frame);
    MapFrame news = map_frame_of(frame, rig);
    if (frame >= kResumed) {
      output.fusion.pose->T_world_body = unseen * output.fusion.pose->T_world_body;
      output.vio.state.R_world_body = output.fusion.pose->T_world_body.rotation;
      output.vio.state.p_world = output.fusion.pose->T_world_body.translation;
      news.T_world_body = unseen * news.T_world_body;
      std::erase_if(news.window, [](const StampedPose& p) { return p.stamp < stamp_of(kResumed); });
      for (StampedPose& pose : news.window) pose.T_world_body = unseen * pose.T_world_body;
    }
    odometry.poses.push_back(*output.fused());
    expected.poses.push_back({output.stamp, truth(frame)});
    smoother.add(output, {}, news);
  }
  smoother.finish();
  EXPECT_EQ(smoother.closer().breaks(), 1U);
  ASSERT_EQ(smoother.closer().reconnections(), 1U);
  const Trajectory smoothed = smoother.smoothed(odometry);
  for (std::size_t i = 0; i < smoothed.size(); ++i) {
    const Eigen::Vector3d error =
        smoothed.poses[i].T_world_body.translation - expected.poses[i].T_world_body.translation;
    EXPECT_LT(error.norm(), 0.15) << i;  // the first lap has no loop before the gap
  }
}

TEST(Smoother, IsAsSmoothAsTheOdometry) {
  const Result result = dive({});
  for (std::size_t i = 1; i < result.smoothed.size(); ++i) {
    const auto step = [i](const Trajectory& t) {
      return (t.poses[i - 1].T_world_body.inverse() * t.poses[i].T_world_body).translation;
    };
    EXPECT_LT((step(result.smoothed) - step(result.odometry)).norm(), 0.01) << i;
  }
}

TEST(Smoother, WithoutALoopTheTrajectoryIsThatOfTheOdometry) {
  Options options;
  options.smoothing.min_age_s = 1e5;
  options.smoothing.bundle_adjustment = false;
  const Result result = dive(options);
  EXPECT_EQ(result.closures, 0U);
  for (std::size_t i = 0; i < result.smoothed.size(); ++i) {
    const SE3 moved =
        result.odometry.poses[i].T_world_body.inverse() * result.smoothed.poses[i].T_world_body;
    EXPECT_LT(moved.translation.norm(), 1e-9) << i;
  }
}

TEST(Smoother, AThreadOfItsOwnGivesTheSameBits) {
  Options replay;
  replay.run.mode = RunMode::replay;
  const Result a = dive({});
  const Result b = dive(replay);
  EXPECT_EQ(a.closures, b.closures);
  for (std::size_t i = 0; i < a.smoothed.size(); ++i) {
    const StampedPose& pose = a.smoothed.poses[i];
    EXPECT_TRUE(is_same(pose.T_world_body, b.smoothed.poses[i].T_world_body));
    EXPECT_TRUE(is_same(a.map.pose(pose.stamp), b.map.pose(pose.stamp)));
  }
}

/// The same dive once more, in the map that it left.
Result second_dive(RunMode mode) {
  static const loop_closure::PlaceMap places = dive({}).places;
  const test::TmpDir run;
  save(places, run.path() / loop_closure::kPlacesFile);
  Options options;
  options.run.mode = mode;
  options.smoothing.known_map = run.path().string();
  return dive(options);
}

TEST(Smoother, ADiveFoundInAKnownMapIsInItsFrame) {
  const Result first = dive({});
  const Result again = second_dive(RunMode::sequential);
  ASSERT_TRUE(again.found);
  EXPECT_FALSE(first.found);
  EXPECT_LT(largest_error(again.smoothed), 1.2 * largest_error(first.smoothed));
  expect_map_on_trajectory(again);
  const SE3 newest = again.T_map_odom * again.odometry.poses.back().T_world_body;
  const SE3& last = again.smoothed.poses.back().T_world_body;
  EXPECT_LT((newest.translation - last.translation).norm(), 1e-9);
}

TEST(Smoother, AKnownMapGivesTheSameBitsOnAThread) {
  const Result a = second_dive(RunMode::sequential);
  const Result b = second_dive(RunMode::replay);
  for (std::size_t i = 0; i < a.smoothed.size(); ++i) {
    EXPECT_TRUE(is_same(a.smoothed.poses[i].T_world_body, b.smoothed.poses[i].T_world_body));
  }
}

TEST(Smoother, AtFirstTheKnownMapIsSearchedForBetweenKeyframes) {
  static const loop_closure::PlaceMap places = dive({}).places;
  const test::TmpDir run;
  save(places, run.path() / loop_closure::kPlacesFile);
  Options options;
  options.smoothing.known_map = run.path().string();
  const Rig rig = floor_rig();
  Smoother smoother(options, rig, {.cameras = 1}, false);
  constexpr int kStep = 10;  // of keyframes
  const int frames = static_cast<int>(19.0 / kPeriod_s);
  for (int frame = 0; frame < frames; ++frame) {
    FrameOutput output = output_of(frame);
    output.vio.landmarks = 50;
    const MapFrame seen = map_frame_of(frame, rig);
    smoother.add(output, seen.image, frame % kStep == 0 ? std::optional(seen) : std::nullopt);
  }
  smoother.finish();
  EXPECT_NEAR(static_cast<double>(smoother.keyframe_seconds().size()),
              19.0 / std::max(0.2, kPeriod_s), 3.0);
}

TEST(Smoother, BridgesASpanWithoutImages) {
  for (const bool restarts : {false, true}) {
    const Result result = dive({}, 60, 90, restarts);
    EXPECT_GT(result.closures, 5U);
    EXPECT_LT(largest_error(result.smoothed), 0.4 * largest_error(result.odometry));
    expect_map_on_trajectory(result);
  }
}

TEST(Smoother, PosesUpToScaleAreNoOdometry) {
  const Rig rig = floor_rig();
  Smoother smoother({}, rig, {.cameras = 1}, false);
  for (int frame = 0; frame < 5; ++frame) {
    FrameOutput output = output_of(frame);
    output.vio.up_to_scale = true;
    smoother.add(output, {}, map_frame_of(frame, rig));
  }
  smoother.finish();
  EXPECT_EQ(smoother.closer().graph().size(), 0U);
  const Trajectory some{{{stamp_of(0), odometry(7)}}};
  EXPECT_EQ(smoother.smoothed(some).poses[0].T_world_body.translation, odometry(7).translation);
}

}  // namespace
}  // namespace apvi::localization
