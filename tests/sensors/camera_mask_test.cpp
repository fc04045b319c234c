// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/camera_mask.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"
#include "apvi/sensors/rig.hpp"
#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

using testing::HasSubstr;

CameraModel camera() {
  CameraModel::Parameters p;
  p.fx = p.fy = 50.0;
  p.cx = 31.5;
  p.cy = 23.5;
  p.width = 64;
  p.height = 48;
  return CameraModel(p);
}

class CameraMaskTest : public testing::Test {
 protected:
  std::string write(const cv::Mat& image, const std::string& name = "mask.png") {
    const std::string file = (dir_.path() / name).string();
    cv::imwrite(file, image);
    return file;
  }
  /// White but for a black part of the vehicle at the lower edge.
  static cv::Mat gripper() {
    cv::Mat image(48, 64, CV_8U, cv::Scalar(255));
    image.rowRange(40, 48).setTo(0);
    return image;
  }
  std::string error_of(const std::string& file) {
    try {
      load_camera_mask(file, camera());
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  }

  test::TmpDir dir_;
};

TEST_F(CameraMaskTest, BlackPixelsAreHidden) {
  const cv::Mat mask = load_camera_mask(write(gripper()), camera());
  EXPECT_TRUE(is_hidden(mask, {10.0F, 40.0F}));
  EXPECT_FALSE(is_hidden(mask, {10.0F, 39.4F}));
  EXPECT_FALSE(is_hidden({}, {10.0F, 40.0F}));
}

TEST_F(CameraMaskTest, LabelsOfZeroAndOneAreAMask) {
  const cv::Mat mask = load_camera_mask(write(gripper() / 255), camera());
  EXPECT_EQ(cv::countNonZero(mask), 64 * 40);
}

TEST_F(CameraMaskTest, ColorsAreRead) {
  cv::Mat color;
  cv::cvtColor(gripper(), color, cv::COLOR_GRAY2BGR);
  EXPECT_EQ(cv::countNonZero(load_camera_mask(write(color), camera())), 64 * 40);
}

TEST_F(CameraMaskTest, FilesThatAreNoMaskAreRefused) {
  EXPECT_THAT(error_of(write(cv::Mat(10, 20, CV_8U, cv::Scalar(0)))),
              HasSubstr("20 x 10 pixels, but the camera has 64 x 48"));
  EXPECT_THAT(error_of(write(cv::Mat(48, 64, CV_8U, cv::Scalar(0)))), HasSubstr("all black"));
  EXPECT_THAT(error_of(write(cv::Mat(48, 64, CV_8U, cv::Scalar(255)))),
              HasSubstr("nothing is black"));
  EXPECT_THAT(error_of("/no/such.png"), HasSubstr("/no/such.png: no such file"));
  EXPECT_THAT(error_of(dir_.write("mask.txt", "black").string()),
              HasSubstr("cannot be read as an image"));
}

TEST_F(CameraMaskTest, TheMaskOfAnImageHasItsName) {
  const auto in = [&](const char* name) { return dir_.write(name, ""); };
  EXPECT_FALSE(find_mask(dir_.path(), "a/1.jpg"));
  const auto as_png = in("a/1.png");
  EXPECT_EQ(find_mask(dir_.path(), "a/1.jpg"), as_png);
  const auto with_png = in("a/1.jpg.png");
  EXPECT_EQ(find_mask(dir_.path(), "a/1.jpg"), with_png);
  const auto same = in("a/1.jpg");
  EXPECT_EQ(find_mask(dir_.path(), "a/1.jpg"), same);
}

TEST_F(CameraMaskTest, CombinedMasksHideWhatEitherHides) {
  const cv::Mat below = gripper();
  cv::Mat left(48, 64, CV_8U, cv::Scalar(255));
  left.colRange(0, 10).setTo(0);
  EXPECT_EQ(cv::countNonZero(combined(below, left)), 54 * 40);
  EXPECT_EQ(cv::countNonZero(combined(below, {})), 64 * 40);
  EXPECT_EQ(cv::countNonZero(combined({}, left)), 54 * 48);
  EXPECT_THROW(combined(below, left.rowRange(0, 9)), RunError);
}

TEST_F(CameraMaskTest, AReducedPixelIsSceneIfAllOfItIs) {
  cv::Mat mask(6, 6, CV_8U, cv::Scalar(255));
  mask.at<unsigned char>(0, 3) = 0;
  const cv::Mat half = reduced_mask(mask, 2, 0);
  EXPECT_EQ(half.size(), cv::Size(3, 3));
  EXPECT_EQ(half.at<unsigned char>(0, 1), 0);
  EXPECT_EQ(cv::countNonZero(half), 8);
  EXPECT_TRUE(reduced_mask({}, 2, 5).empty());
}

TEST_F(CameraMaskTest, TheMarginGrowsWhatIsHidden) {
  cv::Mat mask(9, 9, CV_8U, cv::Scalar(255));
  mask.at<unsigned char>(4, 4) = 0;
  const cv::Mat grown = reduced_mask(mask, 1, 2);
  EXPECT_EQ(cv::countNonZero(grown), 81 - 25);
  EXPECT_EQ(grown.at<unsigned char>(0, 0), 255);  // the image's edge hides nothing
}

TEST_F(CameraMaskTest, TheRigNamesTheFile) {
  const std::string head =
      "cam0:\n  intrinsics: [50, 50, 31.5, 23.5]\n  resolution: [64, 48]\n  mask: ";
  const Rig rig = make_rig(config::parse_yaml(head + write(gripper()), "rig.yaml"));
  EXPECT_EQ(cv::countNonZero(rig.cameras.at(0).mask), 64 * 40);
  try {
    make_rig(config::parse_yaml(head + "nothing.png", "rig.yaml"));
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("rig.yaml:4: cam0.mask: nothing.png: no such file"));
  }
}

}  // namespace
}  // namespace apvi
