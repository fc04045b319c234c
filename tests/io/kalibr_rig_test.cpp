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
using test::expect_forward_camera;
using test::input_error;
using test::kCamchain;
using test::kKalibrImu;
using test::MatrixNear;
using test::replaced;
using test::rig_of;
using test::TmpDir;
using testing::HasSubstr;

TEST(KalibrRig, InvertsTheCameraFromImuTransform) {
  const TmpDir dir;
  const Rig rig = rig_of(dir.write("camchain-imucam.yaml", kCamchain));
  ASSERT_EQ(rig.cameras.size(), 2U);
  expect_forward_camera(rig.cameras[0]);
  const CameraModel::Parameters& p = rig.cameras[0].model.parameters();
  EXPECT_EQ(p.distortion, Distortion::radtan);
  EXPECT_DOUBLE_EQ(p.fx, 458.6);
  EXPECT_DOUBLE_EQ(p.cy, 248.4);
  EXPECT_DOUBLE_EQ(p.coefficients[3], 1.8e-5);
  EXPECT_EQ(p.width, 752);
  EXPECT_EQ(rig.cameras[1].model.parameters().distortion, Distortion::equidistant);
}

TEST(KalibrRig, ChainsTheSecondCameraToTheFirst) {
  const TmpDir dir;
  const SE3 T = rig_of(dir.write("camchain-imucam.yaml", kCamchain)).cameras.at(1).T_body_camera;
  EXPECT_THAT(T.translation, MatrixNear(Vector3d(0.2, -0.02, -0.3), 1e-12));
  EXPECT_THAT(Vector3d(T.rotation * Vector3d::UnitX()), MatrixNear(Vector3d(0, 0, -1), 1e-12));
}

// Kalibr: time of the IMU = stamp + shift. rig.yaml: time of the IMU = stamp - offset.
TEST(KalibrRig, NegatesTheTimeShift) {
  const TmpDir dir;
  const Rig rig = rig_of(dir.write("camchain-imucam.yaml", kCamchain));
  EXPECT_DOUBLE_EQ(rig.cameras.at(0).time_offset_s, -0.03);
  EXPECT_EQ(rig.cameras.at(1).time_offset_s, 0.0);
}

TEST(KalibrRig, ReadsTheImuFileBesideTheChain) {
  const TmpDir dir;
  const auto chain = dir.write("dive-camchain-imucam.yaml", kCamchain);
  ASSERT_TRUE(rig_of(chain).imu);
  EXPECT_EQ(rig_of(chain).imu->rate_hz, ImuCalibration{}.rate_hz);
  // In the form of Kalibr's results.
  dir.write("dive-imu.yaml",
            "imu0:\n  T_i_b: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
            "  gyroscope_noise_density: 1.7e-4\n  accelerometer_random_walk: 3e-3\n"
            "  model: calibrated\n  time_offset: 0.0\n  update_rate: 200.0\n");
  const Rig rig = rig_of(chain);
  EXPECT_EQ(rig.imu->rate_hz, 200.0);
  EXPECT_EQ(rig.imu->gyro_noise_density, 1.7e-4);
  EXPECT_EQ(rig.imu->accel_random_walk, 3e-3);
}

TEST(KalibrRig, RigYamlInheritsFilesOfKalibr) {
  const TmpDir dir;
  dir.write("chain.yaml", kCamchain);
  dir.write("our_imu.yaml", kKalibrImu);
  const Rig rig = rig_of(
      dir.write("rig.yaml",
                "inherit: [chain.yaml, our_imu.yaml]\nworld: ned\ndvl0: {velocity_noise: 0.02}\n"
                "cam0: {rate_hz: 15, T_body_sensor: [1,0,0,5, 0,1,0,0, 0,0,1,0, 0,0,0,1]}\n"));
  EXPECT_EQ(rig.world, WorldFrame::ned);
  EXPECT_EQ(rig.dvl->velocity_noise, 0.02);
  EXPECT_EQ(rig.imu->accel_noise_density, 2e-3);
  EXPECT_EQ(rig.imu->gyro_random_walk, 2e-5);
  EXPECT_EQ(rig.cameras.at(0).rate_hz, 15.0);
  EXPECT_EQ(rig.cameras.at(0).T_body_camera.translation, Vector3d(5, 0, 0));
  // cam1 is given against cam0, and moves with it.
  EXPECT_THAT(rig.cameras.at(1).T_body_camera.translation, MatrixNear(Vector3d(5.12, 0, 0), 1e-12));
}

TEST(KalibrRig, IsReadAsRigYamlOfARecording) {
  const TmpDir dir;
  dir.write("rig.yaml", kKalibrImu);
  test::write_imu(dir, std::string(test::kImuHeader) + test::imu_row(1));
  const auto reader = io::open_sequence(test::config_for(dir.path()), {});
  EXPECT_EQ(make_rig(reader->rig()).imu->gyro_noise_density, 1.7e-4);
}

TEST(KalibrRig, RefusesModelsThatAreNotPinhole) {
  const TmpDir dir;
  const auto error = [&](const std::string& model) {
    const std::string text = replaced(kCamchain, "camera_model: pinhole", "camera_model: " + model);
    return input_error([&] { rig_of(dir.write("chain.yaml", text)); });
  };
  EXPECT_THAT(error("cata"),
              HasSubstr("chain.yaml:8: cam0.camera_model: the camera model cata is not supported; "
                        "expected pinhole, or of Kalibr ds, eucm"));
  EXPECT_THAT(error("ds"), HasSubstr("cam0.distortion_coeffs: distortion besides this camera"));
  EXPECT_THAT(
      input_error([&] {
        rig_of(dir.write("chain.yaml", replaced(kCamchain, "_model: radtan", "_model: fov")));
      }),
      HasSubstr("chain.yaml:10: cam0.distortion_model: lens fov with coefficients [-0.28, "
                "0.07, 0.0002, 1.8e-05]: the lens model is not supported; calibrate again"));
}

TEST(KalibrRig, ReadsSphereModels) {
  const TmpDir dir;
  const auto camera = [&](const std::string& model, const std::string& intrinsics) {
    std::string text = replaced(kCamchain, "camera_model: pinhole", "camera_model: " + model);
    text = replaced(text, "[-0.28, 0.07, 0.0002, 1.8e-05]", "[]");
    text = replaced(text, "distortion_model: radtan", "distortion_model: none");
    return rig_of(dir.write("chain.yaml", replaced(text, "458.6, 457.3, 367.2, 248.4", intrinsics)))
        .cameras.at(0)
        .model;
  };
  const CameraModel::Parameters ds =
      camera("ds", "-0.2, 0.6, 158.6, 157.3, 367.2, 248.4").parameters();
  EXPECT_EQ(ds.distortion, Distortion::double_sphere);
  EXPECT_EQ(ds.coefficients[0], -0.2);
  EXPECT_EQ(ds.coefficients[1], 0.6);
  EXPECT_EQ(ds.fx, 158.6);
  EXPECT_EQ(ds.cy, 248.4);
  EXPECT_EQ(camera("eucm", "0.6, 1.1, 158.6, 157.3, 367.2, 248.4").parameters().distortion,
            Distortion::eucm);
  // Mei's equation: x / (z + xi d).
  const CameraModel omni = camera("omni", "1.5, 700, 701, 367.2, 248.4");
  const Vector3d p(0.3, -0.5, 0.2);
  EXPECT_NEAR(omni.project(p)->x(), 700 * p.x() / (p.z() + 1.5 * p.norm()) + 367.2, 1e-9);
  EXPECT_NEAR(omni.project(p)->y(), 701 * p.y() / (p.z() + 1.5 * p.norm()) + 248.4, 1e-9);
  EXPECT_THAT(input_error([&] { camera("ds", "0.1, 0.6, 158.6, 157.3"); }),
              HasSubstr("cam0.intrinsics: expected 6 numbers (xi, alpha, fu, fv, pu, pv), got 4"));
}

TEST(KalibrRig, ALensHasAModelAndCoefficients) {
  const TmpDir dir;
  const auto chain = [&](const std::string& from, const std::string& to) {
    return dir.write("chain.yaml", replaced(kCamchain, from, to));
  };
  const std::string model = "  distortion_model: radtan\n";
  const std::string k = "  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]\n";
  for (const char* none :
       {"  distortion_model: none\n  distortion_coeffs: []\n", "  distortion_model: none\n"}) {
    const Rig rig = rig_of(chain(k + model, none));
    EXPECT_EQ(rig.cameras.at(0).model.parameters().distortion, Distortion::none);
  }
  EXPECT_THAT(input_error([&] { rig_of(chain(k, "")); }),
              HasSubstr("cam0.distortion_coeffs: missing; expected the coefficients"));
  EXPECT_THAT(input_error([&] { rig_of(chain(model, "")); }),
              HasSubstr("cam0.distortion_model: missing; expected radtan or equidistant"));
  EXPECT_THAT(input_error([&] { rig_of(chain("0.0002, 1.8e-05]", "0.0002]")); }),
              HasSubstr("chain.yaml:9: cam0.distortion_coeffs: lens radtan with coefficients "
                        "[-0.28, 0.07, 0.0002]: radtan takes 4 or 5 or 8 coefficients, got 3"));
  EXPECT_THAT(input_error([&] { rig_of(chain("model: radtan", "model: none")); }),
              HasSubstr("none takes 0 coefficients, got 4"));
}

TEST(KalibrRig, KeysOfRigYamlServeWhereKalibrSaysNothing) {
  const TmpDir dir;
  const std::string k = "  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]\n";
  const std::string own = "  distortion: radtan\n  coefficients: [0.1, 0.2, 0, 0]\n";
  const Rig rig =
      rig_of(dir.write("chain.yaml", replaced(kCamchain, k + "  distortion_model: radtan\n", own)));
  EXPECT_EQ(rig.cameras.at(0).model.parameters().coefficients[0], 0.1);
  EXPECT_THAT(
      input_error([&] { rig_of(dir.write("chain.yaml", replaced(kCamchain, k, k + own))); }),
      HasSubstr("chain.yaml:12: cam0.distortion_model: distortion says the same; delete one"));
}

TEST(KalibrRig, FurtherSensorsAreIgnored) {
  const TmpDir dir;
  std::string chain = kCamchain;
  for (const char* name : {"cam2", "cam10"}) {
    chain += std::string(name) + ": {camera_model: omni, T_cn_cnm1: []}\n";
  }
  EXPECT_EQ(rig_of(dir.write("chain.yaml", chain)).cameras.size(), 2U);
}

TEST(KalibrRig, ErrorsNameFileLineAndKey) {
  const TmpDir dir;
  const auto error = [&](const std::string& from, const std::string& to) {
    return input_error([&] { rig_of(dir.write("chain.yaml", replaced(kCamchain, from, to))); });
  };
  EXPECT_THAT(error("[0.0, -1.0, 0.0, 0.1]", "[0.0, 1.0, 0.0, 0.1]"),
              HasSubstr("chain.yaml:3: cam0.T_cam_imu: expected a rigid transform"));
  EXPECT_THAT(error("[0.0, -1.0, 0.0, 0.1]", "[0.0, one, 0.0, 0.1]"),
              HasSubstr("chain.yaml:3: cam0.T_cam_imu: expected a number, got one"));
  EXPECT_THAT(error("[0.0, -1.0, 0.0, 0.1]", "[0.0, -1.0]"),
              HasSubstr("cam0.T_cam_imu: expected 16 numbers, row by row, got 14"));
  EXPECT_THAT(
      error("[458.6, 457.3, 367.2, 248.4]", "[458.6, 367.2]"),
      HasSubstr("chain.yaml:11: cam0.intrinsics: expected 4 numbers (fx, fy, cx, cy), got"));
  EXPECT_THAT(error("timeshift_cam_imu: 0.03", "timeshift_cam_imu: late"),
              HasSubstr("chain.yaml:14: cam0.timeshift_cam_imu: expected a number, got late"));
  EXPECT_THAT(error("  resolution: [752, 480]\n", ""),
              HasSubstr("cam0.resolution: missing; expected width, height"));
  EXPECT_THAT(
      input_error([&] {
        rig_of(dir.write("imu.yaml", replaced(kKalibrImu, "density: 2.0e-3", "density: low")));
      }),
      HasSubstr("imu.yaml:1: accelerometer_noise_density: expected a number, got low"));
}

TEST(KalibrRig, RefusesASecondCameraWithoutPose) {
  const TmpDir dir;
  const std::string text = replaced(kCamchain, "T_cn_cnm1", "T_unknown");
  EXPECT_THAT(input_error([&] { rig_of(dir.write("chain.yaml", text)); }),
              HasSubstr("cam1.T_body_sensor: missing; expected its pose against the IMU or cam0"));
}

TEST(KalibrRig, RefusesAnImuThatIsNotTheBody) {
  const TmpDir dir;
  const auto error = [&](const std::string& line) {
    return input_error([&] { rig_of(dir.write("imu.yaml", kKalibrImu + line)); });
  };
  EXPECT_THAT(error("T_i_b: [[1,0,0,1], [0,1,0,0], [0,0,1,0], [0,0,0,1]]\n"),
              HasSubstr("imu.yaml:7: T_i_b: expected the identity"));
  EXPECT_THAT(error("time_offset: 0.1\n"), HasSubstr("imu.yaml:7: time_offset: expected 0"));
}

}  // namespace
}  // namespace apvi
