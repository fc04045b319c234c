// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "support/textured_floor.hpp"

namespace apvi::loop_closure {
namespace {

using test::floor_camera;
using test::render_floor;

constexpr int kFeatures = 500;
const double kSigma = 1.0 / floor_camera().parameters().fx;

SE3 above(double x, double y, double height, double heading) {
  return test::camera_looking_down({x, y, height}, heading);
}

Place place_at(const SE3& T_world_camera) {
  return describe_place(render_floor(T_world_camera), floor_camera(), kFeatures);
}

/// A place triangulated with a second image half a meter beside it.
Place known_place_at(const SE3& T_world_camera) {
  Place place = place_at(T_world_camera);
  SE3 beside = T_world_camera;
  beside.translation.x() += 0.4;
  triangulate_points(place, place_at(beside), beside.inverse() * T_world_camera, kSigma);
  return place;
}

TEST(Place, TwoImagesTriangulatePoints) {
  const SE3 here = above(0.0, 0.0, 2.0, 0.0);
  const Place place = known_place_at(here);
  EXPECT_GT(place.triangulated_count(), 100U);
  EXPECT_LT(place.triangulated_count(), place.points.size());
  double sum = 0.0;
  for (const auto& point : place.points) {
    if (point) sum += std::abs((here * *point).z());  // the floor is at zero
  }
  EXPECT_LT(sum / static_cast<double>(place.triangulated_count()), 0.05);
}

TEST(Place, IsRecognizedFromAnotherPose) {
  const SE3 here = above(0.0, 0.0, 2.0, 0.0);
  const Place then = known_place_at(here);
  for (const SE3& there : {above(0.3, -0.2, 2.2, 0.3), above(-0.3, 0.3, 1.7, -2.5)}) {
    const auto place_match = recognize_place(then, place_at(there), kSigma, 20);
    ASSERT_TRUE(place_match.has_value());
    const SE3 T_now_then = there.inverse() * here;
    EXPECT_LT((place_match->T_now_then.translation - T_now_then.translation).norm(), 0.02);
    EXPECT_LT(so3::angle_between(place_match->T_now_then.rotation, T_now_then.rotation), 0.01);
    EXPECT_GE(place_match->matches, place_match->inliers);
  }
}

TEST(Place, SimilarTextureElsewhereIsRejected) {
  const Place then = known_place_at(above(0.0, 0.0, 2.0, 0.0));
  EXPECT_FALSE(recognize_place(then, place_at(above(6.0, 0.0, 2.0, 0.0)), kSigma, 20).has_value());
}

TEST(Place, IsRecognizedInTurbidWaterWithLessLight) {
  const SE3 here = above(0.0, 0.0, 2.0, 0.0);
  const SE3 there = above(0.2, 0.1, 2.0, 0.2);
  const Place then = known_place_at(here);
  const cv::Mat hazy = 0.25 * render_floor(there) + 90.0;
  EXPECT_TRUE(recognize_place(then, describe_place(hazy, floor_camera(), kFeatures), kSigma, 20)
                  .has_value());
}

TEST(Place, UniformImageHasNoFeatures) {
  const Place place =
      describe_place(cv::Mat(240, 320, CV_8U, cv::Scalar(60)), floor_camera(), kFeatures);
  EXPECT_TRUE(place.rays.empty());
  EXPECT_TRUE(match_features(place, place_at(above(0.0, 0.0, 2.0, 0.0))).empty());
  EXPECT_FALSE(recognize_place(place, place, kSigma, 20).has_value());
}

TEST(Place, AMatchIsLessLikelyFromAnotherDirectionOrDistance) {
  const Eigen::Vector3d ahead(0.0, 0.0, 2.0);
  const Eigen::Vector3d aside(2.0 * std::sin(0.5), 0.0, 2.0 * std::cos(0.5));
  EXPECT_DOUBLE_EQ(match_probability(ahead, ahead), 1.0);
  EXPECT_NEAR(match_probability(ahead, aside), 0.16, 0.01);          // 29 degrees, 1.9 sigmas
  EXPECT_NEAR(match_probability(ahead, 2.0 * ahead), 0.044, 0.001);  // 2.5 sigmas
  EXPECT_DOUBLE_EQ(match_probability(ahead, 2.0 * aside), match_probability(2.0 * aside, ahead));
}

TEST(Place, HasNoFeaturesOfWhatTheMaskHides) {
  const cv::Mat image = render_floor(above(0.0, 0.0, 2.0, 0.0));
  cv::Mat mask(240, 320, CV_8U, cv::Scalar(255));
  mask.colRange(0, 120).setTo(0);
  const Place place = describe_place(image, floor_camera(), kFeatures, mask);
  EXPECT_GT(place.rays.size(), 100U);
  for (const Eigen::Vector2d& ray : place.rays) {
    EXPECT_GT(210.0 * ray.x() + 159.5, 120.0);
  }
}

}  // namespace
}  // namespace apvi::loop_closure
