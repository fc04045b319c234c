// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/sensors/rig.hpp"
#include "io/dataset_builder.hpp"
#include "io/rig_files.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using test::expect_forward_camera;
using test::input_error;
using test::kCamchain;
using test::kKalibrImu;
using test::log_of;
using test::replaced;
using test::rig_of;
using test::TmpDir;
using testing::HasSubstr;

constexpr const char* kEstimatorConfig = R"(%YAML:1.0 # need to specify the file type at the top!

verbosity: "INFO"
use_stereo: true
max_cameras: 2
gravity_mag: 9.81
relative_config_imu: "kalibr_imu_chain.yaml"
relative_config_imucam: "kalibr_imucam_chain.yaml"
)";

// The same cameras as above, the first as OpenVINS writes it: T_imu_cam.
void write_openvins(const TmpDir& dir) {
  const std::string chain = kCamchain;
  const std::string pose =
      "cam0:\n  T_imu_cam: #rotation from camera to IMU R_CtoI, position of camera in IMU p_CinI\n"
      "    - [0.0, 0.0, 1.0, 0.2]\n    - [-1.0, 0.0, 0.0, 0.1]\n    - [0.0, -1.0, 0.0, -0.3]\n"
      "    - [0.0, 0.0, 0.0, 1.0]\n";
  dir.write("kalibr_imucam_chain.yaml",
            "%YAML:1.0\n\n" + pose + chain.substr(chain.find("  cam_overlaps")));
  dir.write("kalibr_imu_chain.yaml",
            std::string("%YAML:1.0\n\nimu0:\n  T_i_b:\n    - [1.0, 0.0, 0.0, 0.0]\n"
                        "    - [0.0, 1.0, 0.0, 0.0]\n    - [0.0, 0.0, 1.0, 0.0]\n"
                        "    - [0.0, 0.0, 0.0, 1.0]\n  gyroscope_noise_density: 1.7e-4\n"
                        "  update_rate: 200.0\n  model: \"kalibr\"\n"
                        "  Tw:\n    - [ 1.0, 0.0, 0.0 ]\n    - [ 0.0, 1.0, 0.0 ]\n"
                        "    - [ 0.0, 0.0, 1.0 ]\n"));
}

TEST(OpenVinsRig, ReadsTheFilesThatTheConfigurationNames) {
  const TmpDir dir;
  write_openvins(dir);
  const Rig rig = rig_of(dir.write("estimator_config.yaml", kEstimatorConfig));
  ASSERT_EQ(rig.cameras.size(), 2U);
  expect_forward_camera(rig.cameras[0]);
  EXPECT_DOUBLE_EQ(rig.cameras[0].time_offset_s, -0.03);
  EXPECT_EQ(rig.imu->rate_hz, 200.0);
  EXPECT_EQ(rig.imu->gyro_noise_density, 1.7e-4);
}

TEST(OpenVinsRig, TheTimeOffsetOfTheFirstCameraIsThatOfAll) {
  const TmpDir dir;
  write_openvins(dir);
  const Rig rig = rig_of(dir.write("estimator_config.yaml", kEstimatorConfig));
  EXPECT_DOUBLE_EQ(rig.cameras.at(1).time_offset_s, -0.03);
}

TEST(OpenVinsRig, ReadsItsCalibrationFilesAlone) {
  const TmpDir dir;
  write_openvins(dir);
  const Rig rig = rig_of(dir.path() / "kalibr_imucam_chain.yaml");
  expect_forward_camera(rig.cameras.at(0));
  EXPECT_EQ(rig.imu.value().rate_hz, 200.0);
  EXPECT_EQ(rig_of(dir.path() / "kalibr_imu_chain.yaml").imu.value().rate_hz, 200.0);
}

TEST(OpenVinsRig, UsesAsManyCamerasAsTheConfiguration) {
  const TmpDir dir;
  write_openvins(dir);
  const std::string mono = replaced(kEstimatorConfig, "max_cameras: 2", "max_cameras: 1");
  EXPECT_EQ(rig_of(dir.write("estimator_config.yaml", mono)).cameras.size(), 1U);
}

TEST(OpenVinsRig, NamesTheFileThatIsMissing) {
  const TmpDir dir;
  const auto file = dir.write("estimator_config.yaml", kEstimatorConfig);
  const std::string error = input_error([&] { rig_of(file); });
  EXPECT_THAT(error, HasSubstr("estimator_config.yaml:8: relative_config_imucam: no such file"));
  EXPECT_THAT(error, HasSubstr("kalibr_imucam_chain.yaml"));
  dir.write("estimator_config.yaml", "relative_config_imu: a.yaml\n");
  EXPECT_THAT(
      input_error([&] { rig_of(file); }),
      HasSubstr("relative_config_imucam: missing; expected the name of a calibration file"));
}

TEST(OpenVinsRig, WarnsOfImuErrorsThatAreNotModeled) {
  const TmpDir dir;
  const auto file = dir.write("imu.yaml", std::string(kKalibrImu) +
                                              "Tw: [[1, 0, 0], [0, 1.01, 0], [0, 0, 1]]\n"
                                              "Ta: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n");
  EXPECT_THAT(log_of(file), HasSubstr("Tw: scale and misalignment are not modeled"));
}

}  // namespace
}  // namespace apvi
