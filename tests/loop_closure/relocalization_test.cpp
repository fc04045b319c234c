// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "floor_dive.hpp"
#include "loop_closure/place_index.hpp"

namespace apvi::loop_closure {
namespace {

// The frame of the later dive in that of the floor: other origin and heading.
const SE3 kWorldFloor{so3::exp({0.0, 0.0, 1.2}), {7.0, -3.0, 0.4}};

const Path& known_path() {
  static const Path path = joined(line(-3.5, 3.5, 0.0), line(-3.5, 3.5, 1.2));
  return path;
}

const PlaceMap& known_places() {
  static const PlaceMap map = map_of(known_path());
  return map;
}

/// Errors of the newest keyframe in the known map.
struct Error {
  double position_m = 0.0;
  double rotation = 0.0;
};

Error error_of(const LoopCloser& closer, const SE3& T_floor_camera) {
  const KeyframeGraph& graph = closer.graph();
  const SE3 found = graph.T_world_known().inverse() * graph.corrected_pose(graph.newest());
  return {(found.translation - T_floor_camera.translation).norm(),
          so3::angle_between(found.rotation, T_floor_camera.rotation)};
}

/// Turbid water by little light.
cv::Mat turbid(const SE3& T_floor_camera) {
  return 0.3 * render_floor(T_floor_camera) + 80.0;
}

TEST(Relocalization, IsFoundFromTheFirstImagesInOtherWater) {
  const Path path = line(-2.0, 2.0, 0.4, 0.3);
  const LoopCloser closer = dive(in_map(known_places()), path, kWorldFloor, turbid);
  ASSERT_TRUE(closer.anchors()->found().has_value());
  const FoundInMap& found = *closer.anchors()->found();
  EXPECT_LT(seconds_between(closer.graph()[0].stamp, found.stamp), 3.0);
  EXPECT_GE(found.images, 3U);
  const Error error = error_of(closer, path.back());
  EXPECT_LT(error.position_m, 0.02);
  EXPECT_LT(error.rotation, 0.3 * kRadiansPerDegree);
  EXPECT_GT(closer.anchors()->anchors(), 8U);
  EXPECT_EQ(closer.anchors()->rejected(), 0U);
}

TEST(Relocalization, ErrorOfTheFirstPoseIsThatOfItsCovariance) {
  const Path path = line(-2.0, 2.0, 0.4, 0.3);
  const LoopCloser closer = dive(in_map(known_places()), path, kWorldFloor, turbid);
  const FoundInMap& found = closer.anchors()->found().value();
  const auto index = static_cast<std::size_t>(
      std::lround(seconds_between(closer.graph()[0].stamp, found.stamp) / 0.6));
  Eigen::Vector4d error;
  error.head<3>() = found.T_known_camera.translation - path[index].translation;
  error[3] = so3::yaw(found.T_known_camera.rotation * path[index].rotation.conjugate());
  EXPECT_LT(error.dot(found.covariance.ldlt().solve(error)), 16.25);
  EXPECT_LT(std::sqrt(found.covariance.topLeftCorner<3, 3>().trace()), 0.05);
}

TEST(Relocalization, ADiveElsewhereIsNotFound) {
  const LoopCloser closer = dive(in_map(known_places()), line(-3.5, 3.5, 6.0), kWorldFloor);
  EXPECT_FALSE(closer.anchors()->found().has_value());
  EXPECT_FALSE(closer.graph().has_known_map());
  EXPECT_EQ(closer.anchors()->anchors(), 0U);
}

TEST(Relocalization, DriftAfterwardsIsRemoved) {
  const Path path = line(-3.0, 3.0, 0.3, 0.1);
  LoopCloser closer(in_map(known_places()), floor_camera());
  SE3 odometry;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const double along = 0.02 * static_cast<double>(k);  // 7 % of the way
    odometry = SE3{Eigen::Quaterniond::Identity(), {along, 0.0, 0.0}} * kWorldFloor * path[k];
    Keyframe keyframe;
    keyframe.stamp = Stamp{} + Duration::from_seconds(0.6 * static_cast<double>(k));
    keyframe.T_world_camera = odometry;
    keyframe.drift = {.heading = 1e-7, .horizontal = 4e-4, .vertical = 1e-7};
    closer.add(keyframe, render_floor(path[k]));
  }
  closer.flush();
  EXPECT_LT(error_of(closer, path.back()).position_m, 0.03);
  EXPECT_LT((closer.newest_correction() * odometry).translation.x() - path.back().translation.x(),
            0.03);
}

/// The floor around x = 4 looks like that around x = -2.
constexpr double kApart_m = 6.0;
cv::Mat look_alike(const SE3& T_floor_camera) {
  SE3 pose = T_floor_camera;
  const bool copied = pose.translation.x() > 1.0 && pose.translation.y() < 1.0;
  if (copied) pose.translation.x() -= kApart_m;
  return render_floor(pose);
}

TEST(Relocalization, TwoPlacesThatLookAlikeAreToldApartByWhatFollowsOnly) {
  const Path map_path = joined(joined(line(-4.0, -0.5, 0.0), line(2.0, 5.5, 0.0)),
                               joined(line(2.0, 5.5, 2.0), line(-4.0, -0.5, 2.0)));
  const PlaceMap map = map_of(map_path, look_alike);
  const Path start = line(2.6, 5.0, 0.2, 0.2);
  const LoopCloser ambiguous = dive(in_map(map), start, kWorldFloor, look_alike);
  EXPECT_FALSE(ambiguous.anchors()->found().has_value());
  const Path path = joined(start, line(2.6, 5.0, 2.2, 0.2));
  const LoopCloser closer = dive(in_map(map), path, kWorldFloor, look_alike);
  ASSERT_TRUE(closer.anchors()->found().has_value());
  EXPECT_LT(error_of(closer, path.back()).position_m, 0.03);
}

TEST(PlaceIndex, FindsThePlacesNearAnImage) {
  const PlaceIndex index(known_places());
  for (std::size_t k = 0; k < known_places().places.size(); k += 7) {
    SE3 pose = known_places().places[k].T_map_camera;
    pose.translation += Eigen::Vector3d(0.05, 0.2, 0.1);
    const Place place = describe_place(turbid(pose), floor_camera(), 800);
    const auto found = index.query(place.descriptors, 3);
    ASSERT_EQ(found.size(), 3U);
    for (const std::size_t other : found) {
      const Eigen::Vector3d& there = known_places().places[other].T_map_camera.translation;
      EXPECT_LT((there - pose.translation).norm(), 1.3) << k;
    }
  }
}

TEST(PlaceIndex, AnEmptyMapHasNoPlaces) {
  const PlaceIndex index(PlaceMap{});
  EXPECT_TRUE(index.query(known_places().places[0].descriptors, 3).empty());
}

}  // namespace
}  // namespace apvi::loop_closure
