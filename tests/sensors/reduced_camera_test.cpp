// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/reduced_camera.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace apvi {
namespace {

CameraModel camera_of(int width, int height) {
  return CameraModel({2000.0,
                      2010.0,
                      0.5 * width,
                      0.4 * height,
                      Distortion::radtan,
                      {-0.12, 0.03, 2e-4, -1e-4},
                      width,
                      height});
}

TEST(ReducedCamera, ImagesAreReducedAsLittleAsTheLongerSideNeeds) {
  EXPECT_EQ(reduction_of(camera_of(320, 240), 1280), 1);
  EXPECT_EQ(reduction_of(camera_of(1280, 720), 1280), 1);
  EXPECT_EQ(reduction_of(camera_of(1281, 720), 1280), 2);
  EXPECT_EQ(reduction_of(camera_of(1080, 1920), 1280), 2);
  EXPECT_EQ(reduction_of(camera_of(3840, 2160), 1280), 3);
}

TEST(ReducedCamera, APixelIsTheCenterOfThePixelsItReplaces) {
  const CameraModel camera = camera_of(1922, 1081);
  const CameraModel half = reduced(camera, 2);
  EXPECT_EQ(half.parameters().width, 961);
  EXPECT_EQ(half.parameters().height, 540);
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0.0, 0.0, 1.0), Eigen::Vector3d(0.3, -0.2, 1.0),
                                   Eigen::Vector3d(-0.4, 0.25, 2.0)}) {
    // Pixels 2k and 2k + 1, centers of the recorded image, become pixel k.
    const Eigen::Vector2d recorded = camera.project(p).value();
    const Eigen::Vector2d expected = 0.5 * (recorded - Eigen::Vector2d::Constant(0.5));
    EXPECT_LT((half.project(p).value() - expected).norm(), 1e-9);
  }
}

TEST(ReducedCamera, PixelsAreMeansAndIncompleteOnesAreCutOff) {
  const cv::Mat image =
      (cv::Mat_<unsigned char>(3, 5) << 10, 20, 0, 4, 9, 30, 40, 8, 12, 9, 7, 7, 7, 7, 7);
  const cv::Mat half = reduced(image, 2);
  ASSERT_EQ(half.size(), cv::Size(2, 1));
  EXPECT_EQ(half.at<unsigned char>(0, 0), 25);
  EXPECT_EQ(half.at<unsigned char>(0, 1), 6);
}

TEST(ReducedCamera, TheMaskOfARigIsReducedWithIt) {
  Rig rig;
  rig.cameras.push_back({.model = camera_of(640, 480), .T_body_camera = {}});
  rig.cameras[0].mask = cv::Mat(480, 640, CV_8U, cv::Scalar(255));
  rig.cameras[0].mask.rowRange(400, 480).setTo(0);
  const Rig half = reduced(rig, 320);
  EXPECT_EQ(half.cameras[0].mask.size(), cv::Size(320, 240));
  EXPECT_EQ(cv::countNonZero(half.cameras[0].mask), 320 * 200);
}

}  // namespace
}  // namespace apvi
