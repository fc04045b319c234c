// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/sensors/rig.hpp"
#include "io/dataset_builder.hpp"
#include "io/rig_files.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::input_error;
using test::MatrixNear;
using test::rig_of;
using test::TmpDir;
using testing::HasSubstr;

constexpr const char* kOrbSlam3 = R"(%YAML:1.0

#--------------------------------------------------------------------------------------------
File.version: "1.0"

Camera.type: "PinHole"

Camera1.fx: 458.654
Camera1.fy: 457.296
Camera1.cx: 367.215
Camera1.cy: 248.375

Camera1.k1: -0.28340811
Camera1.k2: 0.07395907
Camera1.p1: 0.00019359
Camera1.p2: 1.76187114e-05

Camera2.fx: 457.587
Camera2.fy: 456.134
Camera2.cx: 379.999
Camera2.cy: 255.238
Camera2.k1: -0.28368365
Camera2.k2: 0.07451284
Camera2.p1: -0.00010473
Camera2.p2: -3.55590700e-05

Camera.width: 752
Camera.height: 480
Camera.fps: 15

Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [0.0, -1.0, 0.0, 0.12,
         1.0, 0.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]

# Transformation from camera 0 to body-frame (imu)
IMU.T_b_c1: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [0.0, 0.0, 1.0, 0.2,
         -1.0, 0.0, 0.0, 0.1,
         0.0, -1.0, 0.0, -0.3,
         0.0, 0.0, 0.0, 1.0]

IMU.NoiseGyro: 1.7e-04
IMU.NoiseAcc: 2.0e-03
IMU.GyroWalk: 1.9393e-05
IMU.AccWalk: 3.e-03
IMU.Frequency: 200.0
ORBextractor.nFeatures: 1200
)";

TEST(OrbSlamRig, ReadsSettingsOfStereoInertial) {
  const TmpDir dir;
  const Rig rig = rig_of(dir.write("EuRoC.yaml", kOrbSlam3));
  EXPECT_EQ(rig.imu->rate_hz, 200.0);
  EXPECT_EQ(rig.imu->gyro_noise_density, 1.7e-4);
  EXPECT_EQ(rig.imu->accel_random_walk, 3e-3);
  ASSERT_EQ(rig.cameras.size(), 2U);
  EXPECT_EQ(rig.cameras[0].rate_hz, 15.0);
  EXPECT_EQ(rig.cameras[0].model.parameters().coefficients[3], 1.76187114e-5);
  EXPECT_EQ(rig.cameras[1].model.parameters().fx, 457.587);
}

TEST(OrbSlamRig, PosesMapTheCameraToTheBody) {
  const TmpDir dir;
  const Rig rig = rig_of(dir.write("EuRoC.yaml", kOrbSlam3));
  const SE3& first = rig.cameras.at(0).T_body_camera;
  EXPECT_THAT(first.translation, MatrixNear(Vector3d(0.2, 0.1, -0.3), 1e-12));
  EXPECT_THAT(Vector3d(first.rotation * Vector3d::UnitZ()), MatrixNear(Vector3d(1, 0, 0), 1e-12));
  // The second camera is 0.12 m to the right; its x axis is the y axis of the first.
  const SE3& second = rig.cameras.at(1).T_body_camera;
  EXPECT_THAT(second.translation, MatrixNear(Vector3d(0.2, -0.02, -0.3), 1e-12));
  EXPECT_THAT(Vector3d(second.rotation * Vector3d::UnitX()), MatrixNear(Vector3d(0, 0, -1), 1e-12));
}

TEST(OrbSlamRig, ReadsTheOlderFisheyeSettings) {
  const TmpDir dir;
  const Rig rig = rig_of(dir.write("TUM_512.yaml", R"(%YAML:1.0
Camera.type: "KannalaBrandt8"
Camera.fx: 190.97
Camera.fy: 190.97
Camera.cx: 254.93
Camera.cy: 256.89
Camera.k1: 0.0034
Camera.k2: 0.0007
Camera.k3: -0.002
Camera.k4: 0.0002
Camera.width: 512
Camera.height: 512
Camera.fps: 20.0
Tbc: !!opencv-matrix
   rows: 3
   cols: 4
   dt: f
   data: [0.0, 0.0, 1.0, 0.5, -1.0, 0.0, 0.0, 0.6, 0.0, -1.0, 0.0, 0.7]
)"));
  const CameraModel::Parameters& p = rig.cameras.at(0).model.parameters();
  EXPECT_EQ(p.distortion, Distortion::equidistant);
  EXPECT_THAT(p.coefficients, testing::ElementsAre(0.0034, 0.0007, -0.002, 0.0002, 0, 0, 0, 0));
  EXPECT_THAT(rig.cameras[0].T_body_camera.translation, MatrixNear(Vector3d(0.5, 0.6, 0.7), 1e-12));
  EXPECT_TRUE(rig.imu);
}

TEST(OrbSlamRig, RectifiedImagesHaveABaselineAndNoLens) {
  const TmpDir dir;
  const Rig rig = rig_of(
      dir.write("stereo.yaml",
                "Camera.type: \"Rectified\"\nCamera1.fx: 400\nCamera1.fy: 400\nCamera1.cx: 320\n"
                "Camera1.cy: 240\nCamera.width: 640\nCamera.height: 480\nStereo.b: 0.11\n"));
  ASSERT_EQ(rig.cameras.size(), 2U);
  EXPECT_EQ(rig.cameras[1].model.parameters().distortion, Distortion::none);
  EXPECT_THAT(rig.cameras[1].T_body_camera.translation, MatrixNear(Vector3d(0.11, 0, 0), 1e-12));
}

// Settings before 1.0 give the baseline times fx.
TEST(OrbSlamRig, OlderRectifiedImagesHaveABaselineTimesTheFocalLength) {
  const TmpDir dir;
  const std::string text =
      "Camera.fx: 400\nCamera.fy: 400\nCamera.cx: 320\nCamera.cy: 240\nCamera.k1: 0.0\n"
      "Camera.k2: 0.0\nCamera.p1: 0.0\nCamera.p2: 0.0\nCamera.width: 640\nCamera.height: 480\n"
      "Camera.bf: 44.0\n";
  const Rig rig = rig_of(dir.write("KITTI.yaml", text));
  ASSERT_EQ(rig.cameras.size(), 2U);
  EXPECT_THAT(rig.cameras[1].T_body_camera.translation, MatrixNear(Vector3d(0.11, 0, 0), 1e-12));
  EXPECT_EQ(rig_of(dir.write("TUM1.yaml", text + "DepthMapFactor: 5000.0\n")).cameras.size(), 1U);
}

TEST(OrbSlamRig, APinholeWithoutCoefficientsHasNoDistortion) {
  const TmpDir dir;
  const std::string text =
      "Camera1.fx: 400\nCamera1.fy: 400\nCamera1.cx: 320\nCamera1.cy: 240\nCamera.width: 640\n"
      "Camera.height: 480\nCamera.newWidth: 320\nCamera.newHeight: 240\nCamera.type: ";
  const CameraModel::Parameters p =
      rig_of(dir.write("orb.yaml", text + "\"PinHole\"\n")).cameras.at(0).model.parameters();
  EXPECT_EQ(p.distortion, Distortion::none);
  EXPECT_EQ(p.width, 640);
  EXPECT_THAT(input_error([&] { rig_of(dir.write("orb.yaml", text + "\"KannalaBrandt8\"\n")); }),
              HasSubstr("lens KannalaBrandt8 with coefficients []: equidistant takes 4"));
}

TEST(OrbSlamRig, ErrorsNameFileLineAndKey) {
  const TmpDir dir;
  const auto error = [&](const std::string& from, const std::string& to) {
    std::string text = kOrbSlam3;
    text.replace(text.find(from), from.size(), to);
    return input_error([&] { rig_of(dir.write("orb.yaml", text)); });
  };
  EXPECT_THAT(error("Camera1.p2: 1.76187114e-05", "Camera1.k3: 0.5"),
              HasSubstr("Camera1.p1: lens PinHole with coefficients "));
  EXPECT_THAT(error("Camera1.cx: 367.215", "Camera1.cx: middle"),
              HasSubstr("orb.yaml:10: Camera1.cx: expected a number, got middle"));
  EXPECT_THAT(error("Camera.width: 752\n", ""),
              HasSubstr("Camera.width: missing; expected pixels"));
  EXPECT_THAT(error("\"PinHole\"", "\"Mei\""), HasSubstr("orb.yaml:6: Camera.type: lens Mei"));
  EXPECT_THAT(error("File.version: \"1.0\"", "LEFT.K: [1]"),
              HasSubstr("orb.yaml:4: LEFT.K: the intrinsics in this file are those of rectified"));
}

}  // namespace
}  // namespace apvi
