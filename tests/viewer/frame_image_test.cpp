// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/frame_image.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

namespace apvi::viewer {
namespace {

constexpr double kFocal_px = 100.0;

Rendering rendering(const std::function<float(int, int)>& depth, float alpha = 1.0F) {
  Rendering r{.color = cv::Mat(60, 80, CV_8UC3, cv::Scalar(10, 20, 30)),
              .depth = cv::Mat(60, 80, CV_32F),
              .alpha = cv::Mat(60, 80, CV_32F, cv::Scalar(alpha))};
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 80; ++x) r.depth.at<float>(y, x) = depth(x, y);
  }
  return r;
}

cv::Vec3b pixel(const LayerImage& image) {
  return image.bgr.at<cv::Vec3b>(30, 40);
}

TEST(LayerImage, ColorsStayAsRendered) {
  EXPECT_EQ(pixel(layer_image(rendering([](int, int) { return 2.0F; }), Layer::seen, kFocal_px)),
            cv::Vec3b(10, 20, 30));
}

TEST(LayerImage, DepthRunsFromBlueToRedBetweenTheLimits) {
  const auto image =
      layer_image(rendering([](int x, int) { return 1.0F + static_cast<float>(x) / 79.0F; }),
                  Layer::depth, kFocal_px);
  EXPECT_NEAR(image.near_m, 1.02F, 0.02F);
  EXPECT_NEAR(image.far_m, 1.98F, 0.02F);
  const auto near = image.bgr.at<cv::Vec3b>(30, 8);
  const auto far = image.bgr.at<cv::Vec3b>(30, 74);
  EXPECT_GT(near[0], near[2]);
  EXPECT_GT(far[2], far[0]);
}

TEST(LayerImage, EmptyPixelsOfDepthAreBlack) {
  const auto image =
      layer_image(rendering([](int, int) { return 2.0F; }, 0.1F), Layer::depth, kFocal_px);
  EXPECT_EQ(pixel(image), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(image.far_m, 0.0F);
}

TEST(LayerImage, AlphaIsGray) {
  EXPECT_EQ(
      pixel(layer_image(rendering([](int, int) { return 2.0F; }, 0.5F), Layer::alpha, kFocal_px)),
      cv::Vec3b(128, 128, 128));
}

TEST(LayerImage, APlaneTowardTheCameraHasItsNormal) {
  const auto image =
      layer_image(rendering([](int, int) { return 2.0F; }), Layer::normals, kFocal_px);
  EXPECT_EQ(pixel(image), cv::Vec3b(255, 128, 128));
}

// The plane n p = d with n = (s, 0, -c): its depth is d f / (s u - c f), and red is s.
TEST(LayerImage, ASlantedPlaneHasItsNormalEverywhere) {
  const double s = 0.6, c = 0.8;
  const auto image =
      layer_image(rendering([&](int x, int) {
                    const double u = x - 39.5;
                    return static_cast<float>(-2.0 * kFocal_px / (s * u - c * kFocal_px));
                  }),
                  Layer::normals, kFocal_px);
  for (const int x : {10, 40, 70}) {
    const auto p = image.bgr.at<cv::Vec3b>(30, x);
    EXPECT_NEAR(p[2], 127.5 * (1.0 + s), 2.0) << x;
    EXPECT_NEAR(p[1], 127.5, 2.0) << x;
    EXPECT_NEAR(p[0], 127.5 * (1.0 + c), 2.0) << x;
  }
}

TEST(FrameImage, PngIsLosslessAndJpegNear) {
  const cv::Mat image(48, 64, CV_8UC3, cv::Scalar(10, 200, 30));
  const auto decoded = [](const std::string& bytes) {
    return cv::imdecode(std::vector<uchar>(bytes.begin(), bytes.end()), cv::IMREAD_COLOR);
  };
  EXPECT_EQ(cv::norm(decoded(png(image)), image, cv::NORM_INF), 0.0);
  EXPECT_LE(cv::norm(decoded(jpeg(image, 90)), image, cv::NORM_INF), 4.0);
}

}  // namespace
}  // namespace apvi::viewer
