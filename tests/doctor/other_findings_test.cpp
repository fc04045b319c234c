// SPDX-License-Identifier: BSD-3-Clause
// Pressure, depth, cameras, rig, and incomplete recordings.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "apvi/core/error.hpp"
#include "doctor/dive.hpp"

namespace apvi::doctor {
namespace {

using test::Dive;
using test::examine;
using test::healthy_dive;
using test::TmpDir;

constexpr const char* kCamera =
    "cam0: {model: pinhole, intrinsics: [100, 100, 31.5, 23.5], distortion: none, resolution: [64, "
    "48], rate_hz: 10}\n";

Dive dive_with_pressure(double factor) {
  Dive dive = healthy_dive();
  test::add_pressure(dive);
  for (PressureSample& s : dive.pressure) s.pressure_pa *= factor;
  return dive;
}

void write_images(const TmpDir& dir, int width, int height) {
  std::string rows = "#timestamp [ns],filename\n";
  std::filesystem::create_directories(dir.path() / "mav0/cam0/data");
  for (int i = 0; i < 30; ++i) {
    const std::string name = fmt::format("{}.png", i);
    rows += fmt::format("{},{}\n", 2'000'000'000 + i * 100'000'000LL, name);
    cv::imwrite((dir.path() / "mav0/cam0/data" / name).string(),
                cv::Mat(height, width, CV_8UC1, cv::Scalar(90)));
  }
  dir.write("mav0/cam0/data.csv", rows);
}

TEST(PressureFindings, HectopascalDeclaredAsPascalIsAnError) {
  EXPECT_FINDING(examine(dive_with_pressure(1e-2)), "pressure0", "unit", error, "hPa");
}

TEST(PressureFindings, KilopascalDeclaredAsPascalIsAnError) {
  EXPECT_FINDING(examine(dive_with_pressure(1e-3)), "pressure0", "unit", error, "kPa");
}

TEST(PressureFindings, UnitsDeclaredInHeaderAreOk) {
  Dive dive = dive_with_pressure(1e-2);
  dive.pressure_unit = "hPa";
  const Report report = examine(dive);
  EXPECT_EQ(report.find("pressure0", "unit")->severity, Severity::ok);
  EXPECT_NEAR(test::value_of(report, "pressure0", "unit", "median_pa"), 2.0e5, 0.3e5);
}

TEST(PressureFindings, CoarseResolutionIsANote) {
  Dive dive = dive_with_pressure(1.0);
  for (PressureSample& s : dive.pressure) s.pressure_pa = 863.0 * std::round(s.pressure_pa / 863.0);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "pressure0", "resolution", note, "noise_m");
  EXPECT_NEAR(test::value_of(report, "pressure0", "resolution", "step_m"), 0.0859, 0.001);
}

TEST(DepthFindings, DepthsAboveTheSurfaceAreAWarning) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  for (PressureDepthSample& s : dive.depth) s.depth_m = -s.depth_m;
  EXPECT_FINDING(examine(dive), "depth0", "depth", warning, "are these heights?");
}

TEST(DepthFindings, DepthsThatAreNeverBelowTheSurfaceAreAWarning) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  for (PressureDepthSample& s : dive.depth) s.depth_m = -0.2 - 0.001 * s.depth_m;
  EXPECT_FINDING(examine(dive), "depth0", "depth", warning, "never below the surface");
}

TEST(DepthFindings, ConstantDepthIsAWarning) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  for (PressureDepthSample& s : dive.depth) s.depth_m = 3.0;
  EXPECT_FINDING(examine(dive), "depth0", "depth", warning, "never changes");
}

TEST(DepthFindings, CountsSpikes) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  dive.depth[300].depth_m += 40.0;
  EXPECT_FINDING(examine(dive), "depth0", "spikes", warning, "2 jumps");
}

TEST(CameraFindings, ImagesOfCalibratedSizeAreOk) {
  Dive dive = healthy_dive();
  dive.rig += kCamera;
  const TmpDir dir;
  test::write_dive(dir, dive);
  write_images(dir, 64, 48);
  EXPECT_FINDING(examine(dir), "cam0", "size", ok, "64x48");
}

TEST(CameraFindings, ImagesOfAnotherSizeAreAnError) {
  Dive dive = healthy_dive();
  dive.rig += kCamera;
  const TmpDir dir;
  test::write_dive(dir, dive);
  write_images(dir, 128, 96);
  EXPECT_FINDING(examine(dir), "cam0", "size", error, "images are 128x96, the rig says 64x48");
}

TEST(CameraFindings, DamagedImageIsAnError) {
  Dive dive = healthy_dive();
  dive.rig += kCamera;
  const TmpDir dir;
  test::write_dive(dir, dive);
  write_images(dir, 64, 48);
  dir.write("mav0/cam0/data/0.png", "no image");
  EXPECT_FINDING(examine(dir), "cam0", "first image", error, "0.png");
}

TEST(CameraFindings, CameraMissingInRigIsAWarning) {
  const TmpDir dir;
  test::write_dive(dir, healthy_dive());
  write_images(dir, 64, 48);
  EXPECT_FINDING(examine(dir), "cam0", "rig", warning, "the rig does not describe it");
}

TEST(Presence, EmptyFileIsASensorThatNeverReports) {
  Dive dive = healthy_dive();
  dive.dvl.clear();
  EXPECT_FINDING(examine(dive), "dvl0", "presence", error, "never reports");
}

TEST(Presence, MissingFileIsAnErrorAndOtherSensorsAreChecked) {
  Dive dive = healthy_dive();
  const TmpDir dir;
  test::write_dive(dir, dive);
  std::filesystem::remove_all(dir.path() / "mav0/dvl0");
  const Report report = examine(dir);
  EXPECT_FINDING(report, "dvl0", "files", error, "missing");
  EXPECT_NE(report.find("imu0", "rate"), nullptr);
}

TEST(Presence, SensorMissingInRigIsAWarning) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  dive.rig.erase(dive.rig.find("depth0"));
  EXPECT_FINDING(examine(dive), "depth0", "rig", warning, "add a depth0 section");
}

TEST(Presence, SensorsWithoutTimeOverlapAreAnError) {
  Dive dive = healthy_dive();
  for (DvlSample& s : dive.dvl) s.stamp = s.stamp + Duration::from_seconds(3600.0);
  const Report report = examine(dive);
  EXPECT_FINDING(report, "dvl0", "common time", error, "two clocks");
  EXPECT_FINDING(report, "dvl0", "common time", error, "dataset.clock_shift_s.dvl=-3600.000");
  EXPECT_EQ(report.find("dvl0", "presence"), nullptr);
}

TEST(RigFindings, RecordingWithoutRigIsCheckedAsFarAsPossible) {
  Dive dive = healthy_dive();
  dive.rig.clear();
  const Report report = examine(dive);
  EXPECT_FINDING(report, "rig", "file", warning, "no calibration");
  EXPECT_NE(report.find("imu0", "gravity"), nullptr);
}

TEST(RigFindings, ReflectionInRigIsAnError) {
  Dive dive = healthy_dive();
  dive.rig.replace(dive.rig.find("0,0,1,0.3"), 9, "0,0,-1,0.3");
  const Report report = examine(dive);
  EXPECT_FINDING(report, "rig", "file", error, "not a rotation");
  EXPECT_EQ(report.findings.front().check, "file");
}

TEST(BadRecordings, MissingPathThrows) {
  io::DatasetConfig config;
  config.path = "/nowhere/at/all";
  EXPECT_THROW(doctor::examine(config), InputError);
  const TmpDir empty;
  EXPECT_THROW(examine(empty), InputError);
}

TEST(BadRecordings, HandlesOneSamplePerSensor) {
  Dive dive = healthy_dive();
  test::add_depth(dive);
  dive.imu.resize(1);
  dive.dvl.resize(1);
  dive.depth.resize(1);
  EXPECT_FINDING(examine(dive), "imu0", "rate", warning, "only one sample");
}

TEST(BadRecordings, HandlesEmptyFiles) {
  Dive dive = healthy_dive();
  dive.imu.clear();
  dive.dvl.clear();
  EXPECT_FINDING(examine(dive), "imu0", "presence", error, "never reports");
}

TEST(BadRecordings, HandlesOnlyNan) {
  Dive dive = healthy_dive();
  for (ImuSample& s : dive.imu) s.accel.setConstant(std::nan(""));
  for (DvlSample& s : dive.dvl) s.velocity.setConstant(std::nan(""));
  EXPECT_FINDING(examine(dive), "imu0", "not finite", error, "invalid");
}

TEST(BadRecordings, HandlesHugeNumbers) {
  Dive dive = healthy_dive();
  test::add_pressure(dive);
  for (std::size_t i = 0; i < dive.imu.size(); i += 7) dive.imu[i].accel *= 1e150;
  for (std::size_t i = 0; i < dive.imu.size(); i += 11) dive.imu[i].gyro *= 1e150;
  for (std::size_t i = 0; i < dive.dvl.size(); i += 13) dive.dvl[i].velocity *= 1e150;
  for (std::size_t i = 0; i < dive.pressure.size(); i += 17) dive.pressure[i].pressure_pa *= 1e150;
  const Report report = examine(dive);
  EXPECT_GT(report.findings.size(), 10u);
}

TEST(BadRecordings, HandlesTimeJumpOfAnHour) {
  Dive dive = healthy_dive();
  for (std::size_t i = 5000; i < dive.imu.size(); ++i) {
    dive.imu[i].stamp = dive.imu[i].stamp + Duration::from_seconds(3600.0);
  }
  EXPECT_FINDING(examine(dive), "imu0", "gaps", warning, "longest step 3.6e+03 s");
}

}  // namespace
}  // namespace apvi::doctor
