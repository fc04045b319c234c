// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "apvi/sensors/rig.hpp"
#include "io/dataset_builder.hpp"
#include "io/rig_files.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::input_error;
using test::kCamchain;
using test::kKalibrImu;
using test::log_of;
using test::MatrixNear;
using test::rig_of;
using test::TmpDir;
using testing::HasSubstr;
using testing::Not;

// The IMU is rotated by 90 degrees about z, and 1 m along x.
void write_euroc(const TmpDir& dir) {
  dir.write("mav0/imu0/sensor.yaml",
            "sensor_type: imu\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0, -1, 0, 1,  1, 0, 0, 0,  "
            "0, 0, 1, 0,  0, 0, 0, 1]\nrate_hz: 200\ngyroscope_noise_density: 1.7e-4\n");
  dir.write("mav0/cam0/sensor.yaml",
            "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0.5,  0, 1, 0, "
            "0.2,  0, 0, 1, 0,  0, 0, 0, 1]\nrate_hz: 20\nresolution: [752, 480]\n"
            "camera_model: pinhole\nintrinsics: [458, 457, 367, 248]\n"
            "distortion_model: radial-tangential\n"
            "distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]\n");
}

TEST(EurocRig, IsReadAsFolderOrByInheritance) {
  const TmpDir dir;
  write_euroc(dir);
  const auto both = dir.write(
      "rig.yaml", "inherit: [mav0/cam0/sensor.yaml, mav0/imu0/sensor.yaml]\nworld: ned\n");
  for (const auto& path : {dir.path() / "mav0", both}) {
    const Rig rig = rig_of(path);
    EXPECT_EQ(rig.imu->gyro_noise_density, 1.7e-4);
    EXPECT_EQ(rig.cameras.at(0).model.parameters().distortion, Distortion::radtan);
    // R^T (p - t), with R about z by 90 degrees: (-0.5, 0.2) -> (0.2, 0.5).
    EXPECT_THAT(rig.cameras[0].T_body_camera.translation, MatrixNear(Vector3d(0.2, 0.5, 0), 1e-12));
  }
}

TEST(EurocRig, ASingleFileIsRecognizedByItsContent) {
  const TmpDir dir;
  write_euroc(dir);
  testing::internal::CaptureStderr();
  const Rig rig = rig_of(dir.path() / "mav0/cam0/sensor.yaml");
  EXPECT_THAT(
      testing::internal::GetCapturedStderr(),
      HasSubstr("sensor.yaml: assumed, as the file does not say: imu0.T_BS = identity, world = up, "
                "cam0.time_offset_s = 0"));
  EXPECT_FALSE(rig.imu);
  EXPECT_THAT(rig.cameras.at(0).T_body_camera.translation, MatrixNear(Vector3d(0.5, 0.2, 0), 0.0));
  EXPECT_THAT(input_error([&] { rig_of(dir.write("odd.yaml", "sensor_type: sonar\n")); }),
              HasSubstr("odd.yaml:1: sensor_type: expected imu or camera, got sonar"));
  EXPECT_THAT(input_error([&] { rig_of(dir.path()); }), HasSubstr("no calibration in this folder"));
}

TEST(RigFile, ReadsRigYamlUnchanged) {
  const TmpDir dir;
  EXPECT_EQ(rig_of(dir.write("rig.yaml", "imu0: {rate_hz: 50}\n")).imu->rate_hz, 50.0);
  EXPECT_THAT(input_error([&] { rig_of(dir.write("rig.yaml", "imu0: {update_rate: 50}\n")); }),
              HasSubstr("rig.yaml:1: unknown key imu0.update_rate"));
}

TEST(RigFile, LineEndsAndByteOrderMarksDoNotMatter) {
  const TmpDir dir;
  std::string text = std::string("\xEF\xBB\xBF%YAML:1.0\n") + kCamchain;
  for (std::size_t at = text.find('\n'); at != std::string::npos; at = text.find('\n', at + 2)) {
    text.insert(at, "\r");
  }
  test::expect_forward_camera(rig_of(dir.write("chain.yaml", text)).cameras.at(0));
}

TEST(RigFile, NamesOfFoldersAreFree) {
  const TmpDir dir;
  dir.write("Höhle #1: a,b/it's-camchain-imucam.yaml", kCamchain);
  dir.write("Höhle #1: a,b/it's-imu.yaml", kKalibrImu);
  const Rig rig = rig_of(
      dir.write("Höhle #1: a,b/rig.yaml", "inherit: \"it's-camchain-imucam.yaml\"\nworld: ned\n"));
  EXPECT_EQ(rig.world, WorldFrame::ned);
  EXPECT_EQ(rig.imu->rate_hz, 200.0);
  test::expect_forward_camera(rig.cameras.at(0));
}

TEST(RigFile, SectionsOfRigYamlMayFollowThoseOfOtherTools) {
  const TmpDir dir;
  write_euroc(dir);
  const auto path = dir.path() / "mav0/cam0/sensor.yaml";
  std::ofstream(path, std::ios::app) << "dvl0: {velocity_noise: 0.02}\ncam0: {rate_hz: 15}\n";
  const Rig rig = rig_of(path);
  EXPECT_EQ(rig.dvl.value().velocity_noise, 0.02);
  EXPECT_EQ(rig.cameras.at(0).rate_hz, 15.0);
  EXPECT_EQ(rig.cameras[0].model.parameters().fx, 458.0);
}

TEST(EurocRig, ErrorsNameFileLineAndKey) {
  const TmpDir dir;
  const auto error = [&](const std::string& line) {
    return input_error(
        [&] { rig_of(dir.write("cam0/sensor.yaml", "sensor_type: camera\n" + line + "\n")); });
  };
  EXPECT_THAT(error("intrinsics: [458, 367, 248]"),
              HasSubstr("sensor.yaml:2: intrinsics: expected 4 numbers (fx, fy, cx, cy), got 3"));
  EXPECT_THAT(error("T_BS: [1, 0, 0]"),
              HasSubstr("sensor.yaml:2: T_BS: expected 16 numbers, row by row, got 3"));
  EXPECT_THAT(error("distortion_model: equidistant"),
              HasSubstr("distortion_coefficients: missing; expected the coefficients"));
  EXPECT_THAT(error("distortion_coefficients: [0, 0, 0, 0]"),
              HasSubstr("distortion_model: missing; expected radtan or equidistant"));
}

TEST(Assumptions, AreLoggedOnceInOneLine) {
  const TmpDir dir;
  const auto file = dir.write("chain.yaml", kCamchain);
  const std::string first = log_of(file);
  EXPECT_THAT(
      first,
      HasSubstr("chain.yaml: assumed, as the file does not say: world = up, imu0.rate_hz = 100, "
                "imu0.gyro_noise_density = 0.001, imu0.gyro_random_walk = 1e-05, "
                "imu0.accel_noise_density = 0.01, imu0.accel_random_walk = 0.0001, "
                "cam0.rate_hz = 20, cam1.rate_hz = 20, cam1.time_offset_s = 0\n"));
  EXPECT_THAT(first, HasSubstr("warning"));
  EXPECT_EQ(log_of(file), "");
}

TEST(Assumptions, OfLittleEffectAreNoWarning) {
  const TmpDir dir;
  dir.write("imu.yaml", kKalibrImu);
  const std::string line = log_of(dir.write("camchain.yaml", kCamchain));
  EXPECT_THAT(line, HasSubstr("cam0.rate_hz = 20"));
  EXPECT_THAT(line, Not(HasSubstr("imu0.")));
  EXPECT_THAT(line, Not(HasSubstr("warning")));
}

TEST(Assumptions, AreNotMadeForARigYaml) {
  const TmpDir dir;
  EXPECT_EQ(log_of(dir.write("rig.yaml", "imu0: {rate_hz: 50}\n")), "");
}

TEST(RigFile, TheMaskOfACameraIsRelativeToItsFile) {
  const TmpDir dir;
  const auto base = dir.write("cameras/base.yaml",
                              "cam0:\n  intrinsics: [50, 50, 31.5, 23.5]\n  resolution: [64, "
                              "48]\n  mask: gripper.png\n");
  const auto rig = dir.write("rig.yaml", "inherit: cameras/base.yaml\nworld: ned\n");
  const config::Node node = io::load_rig_file(rig);
  EXPECT_EQ(node.find("cam0")->find("mask")->text, (dir.path() / "cameras/gripper.png").string());
}

}  // namespace
}  // namespace apvi
