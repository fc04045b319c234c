// SPDX-License-Identifier: BSD-3-Clause
// Faults of camera and gyro in a small simulated dive.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "apvi/core/constants.hpp"
#include "doctor/dive.hpp"
#include "support/run_program.hpp"

namespace apvi::doctor {
namespace {

namespace fs = std::filesystem;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using test::value_of;

struct RigFaults {
  double time_offset_s = 0.04;  // the truth
  Vector3d turn_deg = Vector3d::Zero();
  double focal = 210.0;
  double k1 = -0.11;
  std::string mask{};
};

std::string rig_yaml(const RigFaults& faults) {
  Matrix3d R;
  R << 0.0, -0.42261826, 0.90630779, -1.0, 0.0, 0.0, 0.0, -0.90630779, -0.42261826;
  const double angle = faults.turn_deg.norm() * kRadiansPerDegree;
  const Vector3d axis = angle > 0.0 ? Vector3d(faults.turn_deg.normalized()) : Vector3d::UnitX();
  R = R * Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  return fmt::format(
      "body: imu0\nworld: up\nimu0: {{rate_hz: 200}}\n"
      "cam0:\n  model: pinhole\n  intrinsics: [{0}, {0}, 159.5, 119.5]\n  distortion: radtan\n"
      "  coefficients: [{1}, 0.035, 0, 0]\n  resolution: [320, 240]\n  rate_hz: 10\n"
      "  time_offset_s: {2}\n{12}"
      "  T_body_sensor: [{3}, {4}, {5}, 0.18, {6}, {7}, {8}, 0, {9}, {10}, {11}, -0.03, "
      "0, 0, 0, 1]\n"
      "dvl0:\n  T_body_sensor: [1, 0, 0, -0.12, 0, -1, 0, 0.03, 0, 0, -1, -0.14, 0, 0, 0, 1]\n"
      "  time_offset_s: 0.1\n"
      "pressure0: {{p_body_sensor: [-0.05, 0.06, 0.08]}}\n",
      faults.focal, faults.k1, faults.time_offset_s, R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1),
      R(1, 2), R(2, 0), R(2, 1), R(2, 2),
      faults.mask.empty() ? "" : "  mask: " + faults.mask + "\n");
}

/// A dive of 30 s, simulated once for all tests. Each test examines it with another rig.
class CameraFindings : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    dir_ = std::make_unique<test::TmpDir>();
    dir_->write("rig.yaml", rig_yaml({}));
    const auto scene = dir_->write(
        "scene.yaml",
        "seed: 5\nduration_s: 30\n"
        "world: {kind: seabed, depth_m: 6, size_m: 16, resolution_m: 0.15, marine_life: 0}\n"
        "water: {attenuation_length_m: 9, snow: {density_per_m3: 0}}\n"
        "motion: {origin: [-2, -1, -4.4], length_m: 4, spacing_m: 1.5, lines: 3, rest_s: 0,\n"
        "  altitude_m: 1.6, max_turn_deg_s: 40,\n"
        "  attitude: {oscillation_deg: 4, oscillation_period_s: 2.5}}\n"
        "camera: {blur_samples: 1}\n"
        "truth: {image_every: 0, mesh: false}\n"
        "rig: rig.yaml\n");
    const auto simulated = test::run_program(
        APVI_PROGRAM, {"sim", scene.string(), "-o", (dir_->path() / "dive").string()});
    ASSERT_EQ(simulated.status, 0) << simulated.err;
  }
  static void TearDownTestSuite() { dir_.reset(); }

  static fs::path dive() { return dir_->path() / "dive"; }
  static Report examine_with(const RigFaults& faults, const fs::path& dive) {
    io::DatasetConfig config;
    config.path = dive.string();
    config.rig = dir_->write("other.yaml", rig_yaml(faults)).string();
    return examine(config);
  }
  static Report examine_with(const RigFaults& faults) { return examine_with(faults, dive()); }
  /// A copy that a test may change.
  static fs::path copy(const std::string& name) {
    const fs::path to = dir_->path() / name;
    fs::copy(dive(), to, fs::copy_options::recursive);
    return to;
  }

  static std::unique_ptr<test::TmpDir> dir_;
};

std::unique_ptr<test::TmpDir> CameraFindings::dir_;

TEST_F(CameraFindings, AHealthyCameraHasOneLineWithOffsetAndRotation) {
  const Report report = examine_with({});
  EXPECT_EQ(report.count(Severity::error), 0u) << to_text(report);
  EXPECT_EQ(report.count(Severity::warning), 0u) << to_text(report);
  EXPECT_FINDING(report, "cam0", "gyro", ok, "late by 0.04");
  EXPECT_NEAR(value_of(report, "cam0", "gyro", "time_offset_s"), 0.04, 0.005);
  EXPECT_LT(value_of(report, "cam0", "gyro", "turn_deg"), 2.0);
}

TEST_F(CameraFindings, AWrongTimeOffsetIsAWarningWithTheValueForTheRig) {
  const Report report = examine_with({.time_offset_s = -0.06});
  EXPECT_FINDING(report, "cam0", "time, gyro", warning, "set cam0.time_offset_s: 0.0");
  EXPECT_NEAR(value_of(report, "cam0", "time, gyro", "time_offset_s"), 0.04, 0.005);
}

TEST_F(CameraFindings, ACameraTurnedByFiveDegreesIsAWarning) {
  const Report report = examine_with({.turn_deg = {0.0, 5.0, 0.0}});
  EXPECT_FINDING(report, "cam0", "mounting", warning, "set cam0.T_body_sensor: [");
  EXPECT_NEAR(value_of(report, "cam0", "mounting", "turn_deg"), 5.0, 1.5);
}

TEST_F(CameraFindings, ACameraTurnedByAQuarterIsAnError) {
  const Report report = examine_with({.turn_deg = {0.0, 0.0, 90.0}});
  EXPECT_FINDING(report, "cam0", "mounting", error, "set cam0.T_body_sensor: [");
  EXPECT_NEAR(value_of(report, "cam0", "mounting", "turn_deg"), 90.0, 2.0);
}

TEST_F(CameraFindings, AWrongFocalLengthIsAWarningWithIntrinsics) {
  const Report report = examine_with({.focal = 1.1 * 210.0});
  EXPECT_FINDING(report, "cam0", "focal length", warning, "cam0.intrinsics: [2");
  EXPECT_NEAR(value_of(report, "cam0", "focal length", "fx_px"), 210.0, 5.0);
  EXPECT_EQ(report.find("imu0", "gyro scale, cam0"), nullptr) << to_text(report);
}

TEST_F(CameraFindings, MirroredImagesAreAnError) {
  const fs::path mirrored = copy("mirrored");
  for (const auto& file : fs::directory_iterator(mirrored / "mav0" / "cam0" / "data")) {
    const cv::Mat image = cv::imread(file.path().string(), cv::IMREAD_UNCHANGED);
    cv::Mat flipped;
    cv::flip(image, flipped, 1);
    cv::imwrite(file.path().string(), flipped);
  }
  EXPECT_FINDING(examine_with({}, mirrored), "cam0", "mirrored", error,
                 "flip the images left to right");
}

TEST_F(CameraFindings, AGripperInTheImagesIsAWarningUnlessAMaskHidesIt) {
  const fs::path with_gripper = copy("with_gripper");
  const cv::Rect gripper(120, 170, 70, 70);
  for (const auto& file : fs::directory_iterator(with_gripper / "mav0" / "cam0" / "data")) {
    cv::Mat image = cv::imread(file.path().string());
    image(gripper).setTo(cv::Scalar(40, 160, 190));
    cv::imwrite(file.path().string(), image);
  }
  const Report report = examine_with({}, with_gripper);
  EXPECT_FINDING(report, "cam0", "static parts", warning, "apvi camera mask");
  EXPECT_NEAR(value_of(report, "cam0", "static parts", "share"), gripper.area() / (320.0 * 240.0),
              0.03);
  cv::Mat mask(240, 320, CV_8U, cv::Scalar(255));
  mask(gripper).setTo(0);
  cv::imwrite(dir_->write("mask.png", "").string(), mask);
  const Report masked = examine_with({.mask = "mask.png"}, with_gripper);
  EXPECT_EQ(masked.count(Severity::warning), 0u) << to_text(masked);
}

TEST_F(CameraFindings, AGyroThatReadsTooMuchIsAnErrorOfTheGyroOnly) {
  const fs::path scaled = copy("scaled");
  std::string text = test::read_file(scaled / "mav0" / "imu0" / "data.csv");
  std::string changed = text.substr(0, text.find('\n') + 1);
  for (std::size_t at = changed.size(); at < text.size();) {
    const std::size_t end = text.find('\n', at);
    std::int64_t stamp = 0;
    double w[3];
    int used = 0;
    const std::string line = text.substr(at, end - at);
    ASSERT_EQ(std::sscanf(line.c_str(), "%ld,%lf,%lf,%lf%n", &stamp, &w[0], &w[1], &w[2], &used),
              4);
    changed += fmt::format("{},{},{},{}{}\n", stamp, 1.7 * w[0], 1.7 * w[1], 1.7 * w[2],
                           line.substr(static_cast<std::size_t>(used)));
    at = end + 1;
  }
  std::ofstream(scaled / "mav0" / "imu0" / "data.csv") << changed;
  const Report report = examine_with({}, scaled);
  EXPECT_FINDING(report, "imu0", "gyro scale, cam0", error, "multiply the angular rates by 0.5");
  EXPECT_NEAR(value_of(report, "imu0", "gyro scale, cam0", "scale"), 1.0 / 1.7, 0.02);
  EXPECT_EQ(report.find("cam0", "focal length"), nullptr) << to_text(report);
}

}  // namespace
}  // namespace apvi::doctor
