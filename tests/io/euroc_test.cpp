// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/sensors/rig.hpp"
#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using test::config_for;
using test::input_error;
using test::TmpDir;
using testing::HasSubstr;

// Format of EuRoC's MH_01_easy.
constexpr const char* kImuYaml = R"(#Default imu sensor yaml file
sensor_type: imu
comment: VI-Sensor IMU (ADIS16448)

# Sensor extrinsics wrt. the body-frame.
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 200

# inertial sensor noise model parameters (static)
gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]   ( gyro "white noise" )
gyroscope_random_walk: 1.9393e-05       # [ rad / s^2 / sqrt(Hz) ] ( gyro bias diffusion )
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
)";
constexpr const char* kCameraYaml = R"(%YAML:1.0
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
T_BS: !!opencv-matrix
  cols: 4
  rows: 4
  dt: d
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
)";
constexpr const char* kPublishedImu =
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
    "1403636579758555392,-0.099134701513277898,0.14730578886832138,0.02722713633111154,"
    "8.1476917083333333,-0.37592158333333331,-2.4026292499999999\n";

void write_published(const TmpDir& dir) {
  dir.write("mav0/imu0/sensor.yaml", kImuYaml);
  dir.write("mav0/imu0/data.csv", kPublishedImu);
  dir.write("mav0/cam0/sensor.yaml", kCameraYaml);
  dir.write("mav0/cam0/data.csv",
            "#timestamp [ns],filename\r\n1403636579763555584,1403636579763555584.png\r\n");
  dir.write("mav0/cam0/data/1403636579763555584.png", "not looked at");
}

TEST(PublishedEuroc, ReadsCalibrationFromSensorFiles) {
  const TmpDir dir;
  write_published(dir);
  const auto reader = io::open_sequence(config_for(dir.path()), {});
  const Rig rig = make_rig(reader->rig());
  ASSERT_TRUE(rig.imu);
  EXPECT_DOUBLE_EQ(rig.imu->gyro_noise_density, 1.6968e-4);
  EXPECT_DOUBLE_EQ(rig.imu->accel_random_walk, 3e-3);
  EXPECT_DOUBLE_EQ(rig.imu->rate_hz, 200.0);
  ASSERT_EQ(rig.cameras.size(), 1U);
  const auto& camera = rig.cameras[0];
  EXPECT_EQ(camera.model.parameters().distortion, Distortion::radtan);
  EXPECT_DOUBLE_EQ(camera.model.parameters().fx, 458.654);
  EXPECT_EQ(camera.model.parameters().width, 752);
  EXPECT_NEAR(camera.T_body_camera.translation.y(), -0.064676986768, 1e-12);
  EXPECT_NEAR(camera.T_body_camera.matrix()(1, 0), 0.999557249008, 1e-9);
  EXPECT_TRUE(std::holds_alternative<ImuSample>(reader->next().value()));
  EXPECT_TRUE(std::holds_alternative<ImageFrame>(reader->next().value()));
  EXPECT_FALSE(reader->next());
}

TEST(PublishedEuroc, TransformsPosesToImuFrame) {
  const TmpDir dir;
  write_published(dir);
  std::string yaml =
      kImuYaml;  // the IMU is rotated by 90 degrees about z and offset by 1 m along x
  yaml.replace(yaml.find("1.0, 0.0, 0.0, 0.0"), 18, "0.0, -1.0, 0.0, 1.0");
  yaml.replace(yaml.find("0.0, 1.0, 0.0, 0.0"), 18, "1.0, 0.0, 0.0, 0.0");
  dir.write("mav0/imu0/sensor.yaml", yaml);
  const Rig rig = make_rig(io::open_sequence(config_for(dir.path()), {})->rig());
  const Eigen::Vector3d& p = rig.cameras.at(0).T_body_camera.translation;
  // p_imu = R^T (p_body - t), with R about z by 90 degrees: (x, y) -> (y, -x).
  EXPECT_NEAR(p.x(), -0.064676986768, 1e-9);
  EXPECT_NEAR(p.y(), 1.0 + 0.0216401454975, 1e-9);
}

TEST(PublishedEuroc, CalibrationErrorNamesFileAndLine) {
  const TmpDir dir;
  write_published(dir);
  const auto error = [&](const std::string& yaml) {
    dir.write("mav0/cam0/sensor.yaml", yaml);
    return input_error([&] { make_rig(io::open_sequence(config_for(dir.path()), {})->rig()); });
  };
  EXPECT_THAT(error("rate_hz: [\n"), HasSubstr("cam0/sensor.yaml:"));
  EXPECT_THAT(error("resolution: [1, 2]\nT_BS: {data: [1, 2]}\n"),
              HasSubstr("sensor.yaml:2: T_BS: expected 16 numbers"));
  EXPECT_THAT(error("intrinsics: [1, 2, 3, 4]\nresolution: [0, 2]\n"),
              HasSubstr("cam0/sensor.yaml:2"));
}

// Found by fuzzing: the YAML library reports endless documents for this input.
TEST(PublishedEuroc, RejectsInvalidDirective) {
  const TmpDir dir;
  write_published(dir);
  dir.write("mav0/cam0/sensor.yaml",
            "%Ycv-matrix\n  rows: 4\n  cols: 4\n  data: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n"
            ",0,0, 0,00, 0,0,0,AML:1.0\nT_BS: !!opencv-mat1]\nrate_\nT");
  EXPECT_THAT(input_error([&] { io::open_sequence(config_for(dir.path()), {}); }),
              HasSubstr("cam0/sensor.yaml:"));
}

TEST(PublishedEuroc, IgnoresCameraWithoutCalibration) {
  const TmpDir dir;
  write_published(dir);
  dir.write("mav0/cam1/data.csv", "#timestamp [ns],filename\n1,a.png\n");
  const auto out = test::read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.delivered("camera"), 1U);
}

}  // namespace
}  // namespace apvi
