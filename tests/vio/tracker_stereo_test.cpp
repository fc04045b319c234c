// SPDX-License-Identifier: BSD-3-Clause
// Tracker with a second camera.
#include <gtest/gtest.h>

#include <map>

#include "support/matchers.hpp"
#include "vio/textured_world.hpp"

namespace apvi::vio {
namespace {

using test::frame_stamp;
using test::swaying_pose;

struct StereoDive {
  StereoDive() {
    cameras.push_back(test::small_camera());
    cameras.push_back(test::small_camera());
    const SE3 T_first_second{so3::exp(Eigen::Vector3d(0.01, -0.02, 0.015)),
                             Eigen::Vector3d(0.15, 0.005, -0.01)};
    cameras[1].T_body_camera = cameras[0].T_body_camera * T_first_second;
    cameras[1].model = CameraModel(
        {310.0, 309.0, 241.0, 177.0, Distortion::radtan, {-0.1, 0.02, 0.0, 0.0}, 480, 360});
  }

  SE3 pose(int k, std::size_t camera) const {
    return swaying_pose(k) * cameras[0].T_body_camera.inverse() * cameras[camera].T_body_camera;
  }
  cv::Mat image(int k, std::size_t camera) const {
    return world.view(cameras[camera].model, pose(k, camera));
  }
  std::optional<Eigen::Quaterniond> turn(int k) const {
    if (k == 0) return std::nullopt;
    return test::body_turn(cameras[0], swaying_pose(k - 1), swaying_pose(k));
  }

  test::TexturedWorld world = test::two_walls();
  std::vector<CameraCalibration> cameras;
};

TEST(StereoTracker, SecondCameraUsesTheSameTrackIds) {
  const StereoDive dive;
  Tracker tracker({}, dive.cameras);
  TrackedFrame frame;
  for (int k = 0; k < 4; ++k) {
    frame = tracker.process({dive.image(k, 0), dive.image(k, 1)}, frame_stamp(k), dive.turn(k));
  }
  std::map<std::int64_t, FeatureObservation> first;
  int matched = 0;
  int exact = 0;
  for (const FeatureObservation& o : frame.observations) {
    if (o.camera == 0) {
      first[o.id] = o;
      continue;
    }
    ASSERT_EQ(first.count(o.id), 1U);
    const auto truth =
        dive.world.seen_again(dive.cameras[0].model, dive.pose(3, 0), first[o.id].pixel,
                              dive.cameras[1].model, dive.pose(3, 1));
    ASSERT_TRUE(truth);
    ++matched;
    if ((*truth - o.pixel).norm() < 0.5) ++exact;
    const auto pixel = dive.cameras[1].model.project(o.point.homogeneous());
    ASSERT_TRUE(pixel);
    EXPECT_THAT(*pixel, test::MatrixNear(o.pixel, 1e-6));
  }
  EXPECT_GT(matched, 0.75 * static_cast<double>(first.size()));
  EXPECT_GT(exact, 0.95 * matched);
}

TEST(StereoTracker, ContinuesWithOneCameraIfTheOtherFails) {
  const StereoDive dive;
  Tracker tracker({}, dive.cameras);
  const cv::Mat black(360, 480, CV_8U, cv::Scalar(0));
  for (int k = 0; k < 5; ++k) {
    const cv::Mat second = k == 2 ? black : (k == 3 ? cv::Mat() : dive.image(k, 1));
    const TrackedFrame frame =
        tracker.process({dive.image(k, 0), second}, frame_stamp(k), dive.turn(k));
    EXPECT_EQ(frame.statistics.quality, FrameQuality::good);
    int in_second = 0;
    for (const FeatureObservation& o : frame.observations) in_second += o.camera;
    if (k == 2 || k == 3) {
      EXPECT_EQ(in_second, 0) << k;
    } else {
      EXPECT_GT(in_second, 80) << k;
    }
  }
}

TEST(StereoTracker, UnrelatedImagesGiveAlmostNoMatches) {
  const StereoDive dive;
  Tracker tracker({}, dive.cameras);
  const cv::Mat other = test::random_texture(512, 3)({0, 0, 480, 360});
  const TrackedFrame frame = tracker.process({dive.image(0, 0), other}, frame_stamp(0), {});
  int in_second = 0;
  for (const FeatureObservation& o : frame.observations) in_second += o.camera;
  EXPECT_LE(in_second, 10);
}

}  // namespace
}  // namespace apvi::vio
