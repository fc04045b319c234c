// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/rig.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "apvi/core/error.hpp"
#include "sensors/sound_speed.hpp"
#include "support/matchers.hpp"
#include "support/test_data.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::MatrixNear;
using testing::HasSubstr;

Rig rig_of(const std::string& yaml) {
  return make_rig(config::parse_yaml(yaml, "rig.yaml"));
}

std::string error_of(const std::string& yaml) {
  try {
    rig_of(yaml);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

constexpr const char* kCamera =
    "cam0:\n  intrinsics: [400, 401, 320, 240]\n  distortion: radtan\n"
    "  coefficients: [-0.2, 0.1, 0, 0]\n  resolution: [640, 480]\n";

TEST(Rig, AllSensorsAreOptional) {
  const Rig rig = rig_of("");
  EXPECT_EQ(rig.world, WorldFrame::up);
  EXPECT_FALSE(rig.imu || rig.dvl || rig.pressure || rig.depth);
  EXPECT_TRUE(rig.cameras.empty());
}

TEST(Rig, GravityAndDepthSignFollowWorldFrame) {
  const Rig up = rig_of("world: up");
  EXPECT_EQ(up.gravity(9.8), Vector3d(0, 0, -9.8));
  EXPECT_EQ(up.down_sign(), -1.0);
  const Rig ned = rig_of("world: ned");
  EXPECT_EQ(ned.gravity(9.8), Vector3d(0, 0, 9.8));
  EXPECT_EQ(ned.down_sign(), 1.0);
}

TEST(Rig, ReadsCamera) {
  const Rig rig = rig_of(std::string(kCamera).append("  time_offset_s: 0.05\n"));
  ASSERT_EQ(rig.cameras.size(), 1u);
  const CameraModel::Parameters& p = rig.cameras[0].model.parameters();
  EXPECT_EQ(p.fx, 400);
  EXPECT_EQ(p.fy, 401);
  EXPECT_EQ(p.cx, 320);
  EXPECT_EQ(p.cy, 240);
  EXPECT_EQ(p.distortion, Distortion::radtan);
  EXPECT_EQ(p.coefficients[0], -0.2);
  EXPECT_EQ(p.width, 640);
  EXPECT_EQ(rig.cameras[0].time_offset_s, 0.05);
  EXPECT_THAT(rig.cameras[0].T_body_camera, test::PoseNear(SE3::identity(), 0.0));
}

TEST(Rig, OrthonormalizesRoundedRotation) {
  const Rig rig = rig_of(
      "dvl0: {T_body_sensor: [0.8660, -0.5000, 0, 1, 0.5000, 0.8660, 0, 2, 0, 0, 1, 3, 0, 0, 0, "
      "1]}");
  const SE3& T = rig.dvl->T_body_dvl;
  EXPECT_NEAR(T.rotation.norm(), 1.0, 1e-15);
  const double sixth = std::numbers::pi / 6.0;
  EXPECT_THAT(T.rotation, test::RotationNear(so3::exp(Vector3d(0, 0, sixth)), 1e-4));
  EXPECT_EQ(T.translation, Vector3d(1, 2, 3));
}

TEST(Rig, RejectsReflection) {
  const std::string what =
      error_of("\ndvl0:\n  T_body_sensor: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]\n");
  EXPECT_THAT(what, HasSubstr("rig.yaml:3: dvl0.T_body_sensor:"));
  EXPECT_THAT(what, HasSubstr("determinant -1.0000"));
  EXPECT_THAT(what, HasSubstr("an axis is flipped"));
}

TEST(Rig, RejectsInvalidTransforms) {
  const auto with = [](const std::string& numbers) {
    return error_of(fmt::format("dvl0: {{T_body_sensor: [{}]}}", numbers));
  };
  EXPECT_THAT(with("2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1"), HasSubstr("not a rotation"));
  EXPECT_THAT(with("1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1"), HasSubstr("row-major"));
  EXPECT_THAT(with("1, 0, 0, 0, 1, 0, 0, 0, 1"), HasSubstr("expected 16 numbers, got 9"));
  EXPECT_THAT(with("1, 0, 0, 0, 0, 1, 0, 0, 0, 0, nan, 0, 0, 0, 0, 1"),
              HasSubstr("expected a number"));
}

TEST(Rig, UnknownKeyErrorNamesLineAndSuggestion) {
  EXPECT_EQ(
      error_of("imu0:\n  rate_hz: 100\n  gyro_noise_densty: 1e-3\n"),
      "rig.yaml:3: unknown key imu0.gyro_noise_densty; did you mean imu0.gyro_noise_density?");
  EXPECT_THAT(error_of("\nimu1: {rate_hz: 100}\n"),
              HasSubstr("rig.yaml:2: unknown key imu1; did you mean imu0?"));
}

TEST(Rig, RejectsInvalidValues) {
  EXPECT_THAT(error_of("imu0: {rate_hz: 0}"), HasSubstr("imu0.rate_hz: 0 is outside"));
  EXPECT_THAT(error_of("body: cam0"), HasSubstr("only imu0 can be the body frame"));
  EXPECT_THAT(error_of("world: down"), HasSubstr("none of: up, ned"));
  EXPECT_THAT(error_of("cam1: {}"), HasSubstr("there is no cam0"));
  EXPECT_THAT(error_of("cam0: {intrinsics: [0, 1, 1, 1], resolution: [2, 2]}"),
              HasSubstr("fx and fy must be positive"));
  EXPECT_THAT(error_of("cam0: {intrinsics: [1, 1, 1, 1]}"), HasSubstr("resolution"));
  EXPECT_THAT(error_of("cam0: {intrinsics: [1, 1, 1, 1], resolution: [2, 2], distortion: radtan, "
                       "coefficients: [1, 2, 3, 4, 5, 6]}"),
              HasSubstr("cam0.coefficients: radtan takes 4 or 5 or 8 coefficients, got 6"));
  EXPECT_THAT(error_of("cam0:\n  intrinsics: [1, 1, 1, 1]\n  resolution: [2, 2]\n"
                       "  coefficients: [1, 2, 3, 4]"),
              HasSubstr("rig.yaml:4: cam0.coefficients: 4 coefficients fit radtan and equidistant: "
                        "say which"));
  EXPECT_THAT(error_of("cam0: {intrinsics: [1, 1, 1, 1], resolution: [2, 2], distortion: none, "
                       "coefficients: [1, 2, 3, 4]}"),
              HasSubstr("none takes 0 coefficients, got 4"));
  EXPECT_THAT(error_of("cam0: {model: omni, intrinsics: [1, 1, 1, 1], resolution: [2, 2]}"),
              HasSubstr("only pinhole"));
  EXPECT_THAT(error_of("- 1"), HasSubstr("rig.yaml:1"));
}

TEST(Rig, DefaultBeamsAreUnitVectorsAtJanusAngle) {
  const auto beams = default_dvl_beams();
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& beam : beams) {
    EXPECT_NEAR(beam.norm(), 1.0, 1e-15);
    EXPECT_NEAR(std::acos(beam.z()) * 180.0 / std::numbers::pi, 22.5, 1e-9);
    sum += beam;
  }
  EXPECT_THAT(Vector3d(sum.normalized()), MatrixNear(Vector3d::UnitZ(), 1e-15));
  // Opposite beams have equal sums for any velocity, which the parity test relies on.
  EXPECT_THAT(Vector3d(beams[0] + beams[2]), MatrixNear(Vector3d(beams[1] + beams[3]), 1e-15));
}

TEST(Rig, NormalizesBeamsAndRejectsInvalidOnes) {
  const Rig rig = rig_of(
      "dvl0: {beams: [[0.2706, -0.2706, 0.9239], [0.2706, 0.2706, 0.9239], [-0.2706, 0.2706, "
      "0.9239], "
      "[-0.2706, -0.2706, 0.9239]]}");
  EXPECT_NEAR(rig.dvl->beams[0].norm(), 1.0, 1e-15);
  EXPECT_NEAR(rig.dvl->beams[0].y(), -0.2706, 1e-4);
  EXPECT_THAT(error_of("dvl0: {beams: [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 1]]}"),
              HasSubstr("beam 3 has length 1.4142, not 1"));
  EXPECT_THAT(error_of("dvl0: {beams: [[0, 0, 1]]}"), HasSubstr("expected 4 values, got 1"));
}

TEST(Rig, SoundSpeedSetsDvlScale) {
  EXPECT_EQ(rig_of("dvl0: {}").dvl->scale, 1.0);
  EXPECT_NEAR(rig_of("dvl0: {sound_speed: 1470}").dvl->scale, 0.98, 1e-12);
  EXPECT_NEAR(
      rig_of("dvl0: {sound_speed: {temperature_c: 20, salinity_psu: 0, depth_m: 5}}").dvl->scale,
      sound_speed(20, 0, 5) / 1500.0, 1e-12);
  EXPECT_THAT(error_of("dvl0: {sound_speed: 340}"), HasSubstr("outside [1300, 1700]"));
  EXPECT_THAT(error_of("dvl0: {sound_speed: {temprature_c: 20}}"),
              HasSubstr("did you mean dvl0.sound_speed.temperature_c?"));
}

TEST(Rig, ConvertsPressureToDepth) {
  const Rig rig =
      rig_of("pressure0: {p_body_sensor: [0.1, 0.2, 0.3], water_density: 1000, gravity: 9.8}");
  EXPECT_EQ(rig.pressure->p_body_sensor, Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(rig.pressure->depth(101325.0), 0.0);
  EXPECT_NEAR(rig.pressure->depth(101325.0 + 98000.0), 10.0, 1e-12);
}

TEST(Rig, ReadsLamps) {
  const Rig rig = rig_of(
      "lamp0: {half_beam_deg: 45, T_body_sensor: "
      "[0, 0, 1, 0.3, -1, 0, 0, 0, 0, -1, 0, 0.1, 0, 0, 0, 1]}\n"
      "lamp1: {intensity: 0.5, T_body_sensor: "
      "[1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, -0.1, 0, 0, 0, 1]}");
  ASSERT_EQ(rig.lamps.size(), 2U);
  EXPECT_NEAR(rig.lamps[0].half_beam_rad, std::numbers::pi / 4.0, 1e-12);
  EXPECT_EQ(rig.lamps[0].intensity, 1.0);
  EXPECT_NEAR(rig.lamps[1].half_beam_rad, std::numbers::pi / 3.0, 1e-12);
  EXPECT_EQ(rig.lamps[1].intensity, 0.5);
  EXPECT_EQ(rig.lamps[1].T_body_lamp.translation.z(), -0.1);
  const Eigen::Vector3d axis = rig.lamps[0].T_body_lamp.rotation * Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(axis.x(), 1.0, 1e-12);
  EXPECT_THROW(rig_of("lamp0: {half_beam_deg: 95}"), InputError);
  EXPECT_THROW(rig_of("lamp4: {half_beam_deg: 45}"), InputError);
}

TEST(Rig, DocumentsKeys) {
  const std::string table = rig_documentation();
  for (const char* key :
       {"`world`", "`imu0.gyro_noise_density`", "`cam0.T_body_sensor`", "`cam1.rate_hz`",
        "`dvl0.beams`", "`pressure0.noise_m`", "`depth0.p_body_sensor`"}) {
    EXPECT_THAT(table, HasSubstr(key));
  }
}

TEST(Rig, ReadsRigsOfRealRecordings) {
  for (const char* name : {"akit_01", "blueye_auto_square", "sonia_pool_square", "euroc_mh01_apvi",
                           "euroc_v101_posed"}) {
    APVI_NEEDS_DATA(folder, name);
    EXPECT_NO_THROW(make_rig(config::load_file(folder / "rig.yaml"))) << name;
  }
}

}  // namespace
}  // namespace apvi
