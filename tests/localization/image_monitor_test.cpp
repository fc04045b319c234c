// SPDX-License-Identifier: BSD-3-Clause
#include "localization/image_monitor.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"

namespace apvi::localization {
namespace {

ImageMonitor monitor_of_vga() {
  CameraCalibration camera;
  camera.model = CameraModel(CameraModel::Parameters{
      .fx = 400, .fy = 400, .cx = 320, .cy = 240, .width = 640, .height = 480});
  return ImageMonitor({camera});
}

ImageFrame image_of(int width, int height) {
  return {Stamp{1}, 0, [=] { return cv::Mat(height, width, CV_8UC1, cv::Scalar(9)); }};
}

TEST(ImageMonitor, CountsImagesThatCannotBeUsedAndKeepsTheFirstReason) {
  ImageMonitor monitor = monitor_of_vga();
  EXPECT_EQ(monitor.decode(image_of(640, 480)).cols, 640);
  EXPECT_EQ(monitor.decode(image_of(320, 240)).cols, 320);
  EXPECT_EQ(monitor.decode(image_of(100, 100)).cols, 100);
  for (const char* name : {"first.png", "second.png"}) {
    const ImageFrame damaged{Stamp{1}, 0, [=]() -> cv::Mat { fail_run("{}: damaged", name); }};
    EXPECT_TRUE(monitor.decode(damaged).empty());
  }
  EXPECT_TRUE(monitor.decode({Stamp{1}, 0, nullptr}).empty());  // lost: not an image
  const ImageCounts& counts = monitor.counts().front();
  EXPECT_EQ(counts.images, 5U);
  EXPECT_EQ(counts.wrong_size, 2U);
  EXPECT_EQ(counts.undecodable, 2U);
  EXPECT_THAT(counts.first_undecodable, testing::HasSubstr("first.png"));
  EXPECT_THAT(counts.first_wrong_size, testing::HasSubstr("320 x 240"));
  EXPECT_THAT(counts.first_wrong_size, testing::HasSubstr("640 x 480"));
}

}  // namespace
}  // namespace apvi::localization
