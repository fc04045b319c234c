// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/static_parts.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

#include "vio/textured_world.hpp"

namespace apvi::doctor {
namespace {

constexpr int kImages = 60;
const cv::Size kSize(480, 360);

const std::vector<cv::Mat>& dive() {
  static const std::vector<cv::Mat> images = [] {
    const test::TexturedWorld world = test::two_walls();
    const CameraCalibration camera = test::small_camera();
    std::vector<cv::Mat> all;
    for (int k = 0; k < kImages; ++k) {
      all.push_back(world.view(camera.model, test::swaying_pose(2 * k)));
    }
    return all;
  }();
  return images;
}

const std::vector<cv::Point> kGripper = {{200, 359}, {220, 260}, {270, 260}, {300, 359}};

/// A uniform part of the vehicle, whose brightness changes, and an overlay.
cv::Mat painted(const cv::Mat& scene, int k) {
  cv::Mat image = scene.clone();
  cv::fillConvexPoly(image, kGripper, cv::Scalar(40 + k % 20));
  cv::putText(image, "12.3 m", {20, 40}, cv::FONT_HERSHEY_SIMPLEX, 1.0, cv::Scalar(255), 2);
  return image;
}

/// 255 where `painted` paints.
cv::Mat paint() {
  const cv::Mat black = cv::Mat::zeros(kSize, CV_8U);
  return painted(black, 0) > 0;
}

double fraction(const cv::Mat& part, const cv::Mat& of) {
  return static_cast<double>(cv::countNonZero(part & of)) / cv::countNonZero(of);
}

TEST(StaticParts, AGripperAndAnOverlayAreHidden) {
  StaticParts parts(kSize);
  for (int k = 0; k < kImages; ++k) parts.add(painted(dive().at(static_cast<std::size_t>(k)), k));
  const cv::Mat hidden = parts.mask() == 0;
  EXPECT_GT(fraction(hidden, paint()), 0.98);
  cv::Mat around;
  cv::dilate(paint(), around, cv::Mat::ones(31, 31, CV_8U));
  EXPECT_EQ(cv::countNonZero(hidden & ~around), 0);
  EXPECT_NEAR(parts.share(), static_cast<double>(cv::countNonZero(hidden)) / kSize.area(), 1e-12);
}

TEST(StaticParts, APartAsBrightAsTheSceneIsHidden) {
  StaticParts parts(kSize);
  const cv::Rect skid(300, 250, 120, 110);
  for (const cv::Mat& scene : dive()) {
    cv::Mat image = scene.clone();
    image(skid).setTo(cv::mean(scene));
    parts.add(image);
  }
  cv::Mat painted = cv::Mat::zeros(kSize, CV_8U);
  painted(skid).setTo(255);
  EXPECT_GT(fraction(parts.mask() == 0, painted), 0.98);
  EXPECT_LT(parts.share(), 1.2 * skid.area() / kSize.area());
}

TEST(StaticParts, OpenWaterIsNotHidden) {
  StaticParts parts(kSize);
  for (const cv::Mat& scene : dive()) {
    cv::Mat image = scene.clone();
    for (int y = 0; y < 160; ++y) {  // the scene appears in it by and by
      cv::addWeighted(scene.row(y), y / 160.0, scene.row(y), 0.0, 120.0 * (1.0 - y / 160.0),
                      image.row(y));
    }
    parts.add(image);
  }
  EXPECT_EQ(parts.share(), 0.0);
}

TEST(StaticParts, AMovingSceneHasNone) {
  StaticParts parts(kSize);
  for (const cv::Mat& image : dive()) parts.add(image);
  EXPECT_EQ(parts.images(), kImages);
  EXPECT_EQ(parts.share(), 0.0);
}

TEST(StaticParts, ImagesOfAVehicleThatStandsStillDoNotCount) {
  StaticParts parts(kSize);
  for (int k = 0; k < kImages; ++k) parts.add(dive().front());
  for (int k = 0; k < kImages; ++k) parts.add(cv::Mat::zeros(kSize, CV_8U));
  parts.add(cv::Mat::zeros(10, 10, CV_8U));
  EXPECT_EQ(parts.images(), 1);
  EXPECT_EQ(parts.share(), 0.0);
}

TEST(StaticParts, TheMaskOfReducedImagesHasTheirFullSize) {
  StaticParts parts({1001, 701});
  for (int k = 0; k < kImages; ++k) {
    cv::Mat image;
    cv::resize(painted(dive().at(static_cast<std::size_t>(k)), k), image, {1001, 701});
    parts.add(image);
  }
  EXPECT_EQ(parts.mask().size(), cv::Size(1001, 701));
  EXPECT_EQ(parts.mean_image().size(), cv::Size(1001, 701));
  EXPECT_GT(parts.share(), 0.03);
}

}  // namespace
}  // namespace apvi::doctor
