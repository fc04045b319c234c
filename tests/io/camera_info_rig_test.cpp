// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/sensors/rig.hpp"
#include "io/dataset_builder.hpp"
#include "io/rig_files.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using test::input_error;
using test::rig_of;
using test::TmpDir;
using testing::HasSubstr;

// As camera_calibration writes it.
std::string camera_info(const std::string& model, const std::string& coefficients,
                        const std::string& name = "narrow_stereo") {
  return fmt::format(R"(image_width: 640
image_height: 480
camera_name: {}
camera_matrix:
  rows: 3
  cols: 3
  data: [430.15433, 0.0, 320.54, 0.0, 431.2, 238.1, 0.0, 0.0, 1.0]
distortion_model: {}
distortion_coefficients:
  rows: 1
  cols: 5
  data: [{}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [420.0, 0.0, 319.0, 0.0, 0.0, 421.0, 239.0, 0.0, 0.0, 0.0, 1.0, 0.0]
)",
                     name, model, coefficients);
}

TEST(CameraInfoRig, ReadsFiveCoefficientsWhoseLastIsZero) {
  const TmpDir dir;
  const Rig rig =
      rig_of(dir.write("ost.yaml", camera_info("plumb_bob", "-0.36, 0.11, 0.002, -0.001, 0.0")));
  ASSERT_EQ(rig.cameras.size(), 1U);
  const CameraModel::Parameters& p = rig.cameras[0].model.parameters();
  EXPECT_EQ(p.distortion, Distortion::radtan);
  EXPECT_THAT(p.coefficients, testing::ElementsAre(-0.36, 0.11, 0.002, -0.001, 0, 0, 0, 0));
  EXPECT_DOUBLE_EQ(p.fx, 430.15433);
  EXPECT_DOUBLE_EQ(p.fy, 431.2);
  EXPECT_DOUBLE_EQ(p.cx, 320.54);
  EXPECT_DOUBLE_EQ(p.cy, 238.1);
  EXPECT_EQ(p.width, 640);
  EXPECT_EQ(p.height, 480);
  EXPECT_FALSE(rig.imu);
}

TEST(CameraInfoRig, RefusesCoefficientsThatAreNotModeled) {
  const TmpDir dir;
  const auto error = [&](const char* model, const char* k) {
    return input_error([&] { rig_of(dir.write("ost.yaml", camera_info(model, k))); });
  };
  EXPECT_THAT(error("rational_polynomial", "1, 2, 0, 0, 0, 0, 0.5, 0, 0.1, 0, 0, 0"),
              HasSubstr("ost.yaml:10: distortion_coefficients: lens rational_polynomial with "
                        "coefficients [1, 2, 0, 0, 0, 0, 0.5, 0, 0.1, 0, 0, 0]: number 9 is not 0, "
                        "and is not modeled; calibrate again as radtan"));
  EXPECT_THAT(error("equidistant", "0.1, 0.2, 0.3, 0.4, 0.5"),
              HasSubstr("equidistant takes 4 coefficients, got 5"));
  EXPECT_THAT(error("mei", "0.1, 0.2, 0, 0"),
              HasSubstr("distortion_model: lens mei with coefficients [0.1, 0.2, 0, 0]"));
}

TEST(CameraInfoRig, ReadsOtherLenses) {
  const TmpDir dir;
  const auto lens = [&](const char* model, const char* k) {
    return rig_of(dir.write("ost.yaml", camera_info(model, k))).cameras.at(0).model.parameters();
  };
  EXPECT_EQ(lens("rational_polynomial", "0.1, 0.2, 0, 0, 0, 0, 0, 0").distortion,
            Distortion::radtan);
  EXPECT_EQ(lens("equidistant", "0.1, 0.2, 0.3, 0.4").distortion, Distortion::equidistant);
  EXPECT_EQ(lens("equidistant", "0.1, 0.2, 0.3, 0.4").coefficients[3], 0.4);
  EXPECT_EQ(lens("plumb_bob", "").distortion, Distortion::none);
}

TEST(CameraInfoRig, ReadsAllCoefficientsOfOpenCv) {
  const TmpDir dir;
  const auto lens = [&](const char* model, const char* k) {
    return rig_of(dir.write("ost.yaml", camera_info(model, k))).cameras.at(0).model.parameters();
  };
  EXPECT_THAT(lens("plumb_bob", "-0.36, 0.11, 0, 0, 0.2").coefficients,
              testing::ElementsAre(-0.36, 0.11, 0, 0, 0.2, 0, 0, 0));
  const auto rational = lens("rational_polynomial", "0.5, 0.2, 0, 0, 0.01, 0.8, 0.1, 0.02");
  EXPECT_EQ(rational.distortion, Distortion::radtan);
  EXPECT_THAT(rational.coefficients, testing::ElementsAre(0.5, 0.2, 0, 0, 0.01, 0.8, 0.1, 0.02));
  // Of OpenCV's twelve, thin prism coefficients must be zero.
  EXPECT_EQ(lens("rational_polynomial", "0.5, 0, 0, 0, 0, 0.8, 0, 0, 0, 0, 0, 0").coefficients[5],
            0.8);
}

TEST(CameraInfoRig, TheModelMayBeNamedCameraModelOrMissing) {
  const TmpDir dir;
  const std::string key = "distortion_model: equidistant\n";
  const std::string text = camera_info("equidistant", "0.1, 0.2, 0, 0.");
  const auto named =
      dir.write("named.yaml", test::replaced(text, key, "camera_model: equidistant\n"));
  EXPECT_EQ(rig_of(named).cameras.at(0).model.parameters().distortion, Distortion::equidistant);
  const auto unnamed = dir.write("unnamed.yaml", test::replaced(text, key, ""));
  EXPECT_THAT(test::log_of(unnamed),
              HasSubstr("distortion_model: missing; plumb_bob is assumed\n"));
  EXPECT_EQ(rig_of(unnamed).cameras.at(0).model.parameters().distortion, Distortion::radtan);
}

TEST(CameraInfoRig, WithoutExtrinsicsTheIdentityIsAssumed) {
  const TmpDir dir;
  const std::string text = camera_info("plumb_bob", "0, 0, 0, 0, 0");
  const std::string line = test::log_of(dir.write("ost.yaml", text));
  EXPECT_THAT(line, HasSubstr("warning"));
  EXPECT_THAT(line, HasSubstr("ost.yaml: assumed, as the file does not say: world = up, "
                              "cam0.T_body_sensor = identity, cam0.rate_hz = 20, "
                              "cam0.time_offset_s = 0\n"));
}

TEST(CameraInfoRig, TheRightCameraIsTheSecond) {
  const TmpDir dir;
  const std::string k = "0, 0, 0, 0, 0";
  dir.write("left.yaml", camera_info("plumb_bob", k, "narrow_stereo/left"));
  dir.write("right.yaml", camera_info("plumb_bob", k, "narrow_stereo/right"));
  const std::string rig = "inherit: [left.yaml, right.yaml]\n";
  EXPECT_THAT(input_error([&] { rig_of(dir.write("rig.yaml", rig)); }),
              HasSubstr("cam1.T_body_sensor: missing"));
  const std::string pose = "cam1: {T_body_sensor: [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}\n";
  EXPECT_EQ(rig_of(dir.write("rig.yaml", rig + pose)).cameras.size(), 2U);
  EXPECT_THAT(input_error([&] { rig_of(dir.path() / "right.yaml"); }),
              HasSubstr("right.yaml:1: cam1: there is no cam0: inherit the file of the first"));
  EXPECT_EQ(rig_of(dir.write("bright.yaml", camera_info("plumb_bob", k))).cameras.size(), 1U);
}

TEST(CameraInfoRig, ErrorsNameFileLineAndKey) {
  const TmpDir dir;
  EXPECT_THAT(input_error([&] {
                rig_of(dir.write("ost.yaml", "image_width: 640\ncamera_matrix: {data: [1, 2]}\n"));
              }),
              HasSubstr("ost.yaml:2: camera_matrix: expected 9 numbers (a 3x3 matrix), got 2"));
  EXPECT_THAT(input_error([&] {
                rig_of(dir.write("ost.yaml",
                                 "image_width: 640\ncamera_matrix:\n  data: [1, 0, 3, "
                                 "0, 1, 3, 0, 0, 1]\n"));
              }),
              HasSubstr("image_height: missing; expected pixels"));
}

}  // namespace
}  // namespace apvi
