// SPDX-License-Identifier: BSD-3-Clause
#include "slam/camera_conversion.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "apvi/core/error.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "support/matchers.hpp"

namespace apvi::slam {
namespace {

CameraModel::Parameters euroc_camera() {
  return {.fx = 458.654,
          .fy = 457.296,
          .cx = 367.215,
          .cy = 248.375,
          .distortion = Distortion::radtan,
          .coefficients = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05},
          .width = 752,
          .height = 480};
}

// A blurred spot at a pixel, in OpenCV's convention.
cv::Mat spot_at(const Eigen::Vector2d& pixel, int width, int height) {
  cv::Mat image(height, width, CV_8U);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double r2 = (Eigen::Vector2d(u, v) - pixel).squaredNorm();
      image.at<std::uint8_t>(v, u) =
          static_cast<std::uint8_t>(std::lround(255.0 * std::exp(-r2 / 32.0)));
    }
  }
  return image;
}

// Intensity centroid, pixel centers at +0.5.
Eigen::Vector2d center_of(const cv::Mat& image) {
  double sum = 0.0;
  Eigen::Vector2d moment = Eigen::Vector2d::Zero();
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const double value = image.at<std::uint8_t>(v, u);
      sum += value;
      moment += value * Eigen::Vector2d(u + 0.5, v + 0.5);
    }
  }
  return moment / sum;
}

TEST(CameraConversion, UndistortedImageAgreesWithPinholeProjection) {
  const CameraModel camera(euroc_camera());
  for (const double scale : {1.0, 0.5}) {
    const Undistorter undistort(camera, scale);
    const gaussians::Intrinsics& k = undistort.intrinsics();
    for (const Eigen::Vector3d& point :
         {Eigen::Vector3d(0.0, 0.0, 1.0), Eigen::Vector3d(-0.4, 0.3, 1.1),
          Eigen::Vector3d(0.9, -0.5, 2.0)}) {
      const cv::Mat image = undistort(spot_at(*camera.project(point), 752, 480));
      const Eigen::Vector2d expected(k.fx * point.x() / point.z() + k.cx,
                                     k.fy * point.y() / point.z() + k.cy);
      // Distortion shifts the spot's centroid by up to a tenth of a pixel.
      EXPECT_LT((center_of(image) - expected).norm(), 0.15 * scale) << scale << " " << point.x();
    }
  }
}

TEST(CameraConversion, PixelConventionsDifferByHalfAPixel) {
  const gaussians::Intrinsics k = to_intrinsics(euroc_camera());
  EXPECT_DOUBLE_EQ(k.cx, 367.715);
  EXPECT_DOUBLE_EQ(k.cy, 248.875);
  const CameraModel::Parameters back = to_parameters(k);
  EXPECT_DOUBLE_EQ(back.cx, 367.215);
  EXPECT_DOUBLE_EQ(back.cy, 248.375);
}

TEST(CameraConversion, BarrelDistortionKeepsFocalLength) {
  const Undistorter undistort(CameraModel(euroc_camera()), 0.5);
  EXPECT_DOUBLE_EQ(undistort.intrinsics().fx, 0.5 * 458.654);
  EXPECT_EQ(undistort.intrinsics().width, 376);
  EXPECT_EQ(undistort.intrinsics().height, 240);
}

TEST(CameraConversion, PincushionDistortionIncreasesFocalLengthUntilNoPixelIsEmpty) {
  CameraModel::Parameters lens = euroc_camera();
  lens.coefficients = {0.1, 0.0, 0.0, 0.0};
  const Undistorter undistort(CameraModel(lens), 1.0);
  EXPECT_GT(undistort.intrinsics().fx, lens.fx);
  EXPECT_LT(undistort.intrinsics().fx, 1.2 * lens.fx);
}

// Gray image with the vignetting of the distorted lens.
cv::Mat falling_off(const CameraModel::Parameters& lens, const medium::Vignetting& vignetting) {
  cv::Mat image(lens.height, lens.width, CV_8U);
  const double corner2 = 0.25 * (lens.width * lens.width + lens.height * lens.height);
  for (int v = 0; v < lens.height; ++v) {
    for (int u = 0; u < lens.width; ++u) {
      const double r2 = (Eigen::Vector2d(u - lens.cx, v - lens.cy)).squaredNorm() / corner2;
      image.at<std::uint8_t>(v, u) = cv::saturate_cast<std::uint8_t>(
          250.0 * std::exp(-r2 * (vignetting.square + vignetting.fourth * r2)));
    }
  }
  return image;
}

TEST(CameraConversion, LensSpreadReproducesVignettingOfDistortedImage) {
  constexpr medium::Vignetting kVignetting{.square = 0.4, .fourth = 0.1};
  CameraModel::Parameters fisheye = euroc_camera();
  fisheye.distortion = Distortion::equidistant;
  fisheye.coefficients = {-0.01, 0.02, -0.01, 0.003};
  for (const CameraModel::Parameters& lens : {euroc_camera(), fisheye}) {
    const Undistorter undistort(CameraModel(lens), 0.5);
    ASSERT_NEAR(undistort.intrinsics().fx, 0.5 * lens.fx, 1e-9);  // otherwise the corners differ
    const torch::Tensor image = to_tensor(undistort(falling_off(lens, kVignetting))).slice(2, 0, 1);
    const torch::Tensor expected =
        250.0 * mapping::lens_falloff(undistort.intrinsics(), kVignetting, torch::kCPU);
    EXPECT_LT((image - expected).abs().max().item<float>(), 1.0F);
    gaussians::Intrinsics pinhole = undistort.intrinsics();
    pinhole.lens_spread = {};
    const torch::Tensor plain = 250.0 * mapping::lens_falloff(pinhole, kVignetting, torch::kCPU);
    EXPECT_GT((image - plain).abs().max().item<float>(), 8.0F);  // the effect is significant
  }
}

TEST(CameraConversion, RejectsImagesOfAnotherSize) {
  const Undistorter undistort(CameraModel(euroc_camera()), 1.0);
  EXPECT_THROW(undistort(cv::Mat(10, 10, CV_8U, cv::Scalar(0))), RunError);
}

TEST(CameraConversion, DoesNotModifyInputImage) {
  const Undistorter undistort(CameraModel(euroc_camera()), 1.0);
  cv::Mat image(480, 752, CV_8UC3);
  cv::RNG random(11);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  const cv::Mat before = image.clone();
  const cv::Mat undistorted = undistort(image);
  EXPECT_EQ(cv::norm(image, before, cv::NORM_INF), 0.0);
  EXPECT_GT(cv::norm(undistorted, before, cv::NORM_INF), 0.0);
}

TEST(CameraConversion, PosesRoundTrip) {
  const SE3 pose{Eigen::Quaterniond(0.5, -0.5, 0.1, 0.7).normalized(), {1.0, -2.0, 3.0}};
  EXPECT_THAT(to_se3(to_tensor(pose)), test::PoseNear(pose, 1e-12));
  EXPECT_DOUBLE_EQ(to_tensor(pose)[1][3].item<double>(), -2.0);
}

TEST(CameraConversion, LampIsInCameraFrame) {
  Rig rig;
  EXPECT_TRUE(lamps_of(rig).empty());
  // The camera looks along the body's x axis; the lamp, 20 cm to its right, points straight down.
  Eigen::Matrix3d forward;
  forward << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  rig.cameras.push_back({.model = CameraModel(euroc_camera()),
                         .T_body_camera = {Eigen::Quaterniond(forward), {0.3, 0.0, 0.1}}});
  EXPECT_TRUE(lamps_of(rig).empty());
  const Eigen::Quaterniond down(Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()));
  rig.lamps = {{.T_body_lamp = {down, {0.3, -0.2, 0.1}}, .half_beam_rad = 0.8},
               {.T_body_lamp = {down, {0.3, 0.2, 0.1}}, .intensity = 3.0}};
  const std::vector<medium::Lamp> lamps = lamps_of(rig);
  ASSERT_EQ(lamps.size(), 2U);
  EXPECT_NEAR(lamps[0].position_m[0], 0.2, 1e-12);
  EXPECT_NEAR(lamps[0].position_m[1], 0.0, 1e-12);
  EXPECT_NEAR(lamps[0].axis[1], 1.0, 1e-12);
  EXPECT_EQ(lamps[0].half_beam_rad, 0.8);
  EXPECT_EQ(lamps[0].share, 0.25);
  EXPECT_EQ(lamps[1].share, 0.75);
}

TEST(CameraConversion, ImagesRoundTripWithColors) {
  cv::Mat bgr(2, 3, CV_8UC3, cv::Scalar(10, 20, 30));
  bgr.at<cv::Vec3b>(1, 2) = {1, 2, 3};
  const torch::Tensor rgb = to_tensor(bgr);
  EXPECT_EQ(rgb[0][0][0].item<int>(), 30);
  EXPECT_EQ(rgb[1][2][2].item<int>(), 1);
  const cv::Mat again = to_image(rgb.to(torch::kFloat32) / 255.0);
  EXPECT_EQ(cv::norm(again, bgr, cv::NORM_INF), 0.0);
  EXPECT_EQ(to_tensor(cv::Mat(2, 2, CV_8U, cv::Scalar(9)))[1][1][1].item<int>(), 9);
}

TEST(Undistorter, AMaskedPixelIsSceneIfAllThatItIsInterpolatedFromIs) {
  const CameraModel camera(
      {60.0, 60.0, 31.5, 23.5, Distortion::radtan, {-0.2, 0.05, 0.0, 0.0}, 64, 48});
  const Undistorter undistort(camera, 1.0);
  cv::Mat mask(48, 64, CV_8U, cv::Scalar(255));
  mask.rowRange(30, 48).setTo(0);
  const cv::Mat undistorted = undistort.mask(mask);
  const cv::Mat interpolated = undistort(mask);
  EXPECT_EQ(undistorted.size(), cv::Size(64, 48));
  EXPECT_EQ(cv::countNonZero(undistorted), cv::countNonZero(interpolated == 255));
  EXPECT_LT(cv::countNonZero(undistorted), cv::countNonZero(interpolated));
  EXPECT_TRUE(undistort.mask({}).empty());
  const torch::Tensor scene = scene_of(undistorted);
  EXPECT_EQ(scene.sum().item<int>(), cv::countNonZero(undistorted));
  EXPECT_EQ(cv::countNonZero(mask_of(scene) != undistorted), 0);
  EXPECT_FALSE(scene_of({}).defined());
}

}  // namespace
}  // namespace apvi::slam
