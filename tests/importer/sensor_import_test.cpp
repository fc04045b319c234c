// SPDX-License-Identifier: BSD-3-Clause
// Videos with the sensors of another device, and logs without images.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/config/node.hpp"
#include "apvi/sensors/rig.hpp"
#include "importer/import.hpp"
#include "importer/source_files.hpp"
#include "importer/vehicle/sensor_files.hpp"
#include "importer/vehicle/sensor_rig.hpp"
#include "importer/vehicle/video_sensors.hpp"
#include "importer/vehicle_bytes.hpp"
#include "io/dataset_builder.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using Eigen::Vector3d;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr std::int64_t kStart_s = 1'700'000'000;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

#define NEEDS_VIDEO(path, images) \
  if (!write_video(path, images)) GTEST_SKIP() << "this OpenCV cannot write videos"

class SensorImportTest : public testing::Test {
 protected:
  fs::path out() const { return dir_.path() / "dive"; }
  DatasetContents dive() const { return read_dataset(config_for(out())); }
  Rig rig() const { return make_rig(config::load_file(out() / "rig.yaml")); }

  // 100 s of an IMU at rest at 50 Hz and pressure, from `kStart_s` on.
  fs::path telemetry_log() const {
    std::string log;
    for (std::uint64_t i = 0; i < 5000; ++i) {
      const std::uint64_t us = 20'000 * i;
      log += telemetry(1'000'000 * kStart_s + us,
                       raw_imu_frame(10'000'000 + us, {0, 0, -1000, 10, -20, 30}));
      if (i % 5 != 0) continue;
      log += telemetry(1'000'000 * kStart_s + us,
                       pressure_frame(io::mavlink::Id::scaled_pressure2,
                                      static_cast<std::uint32_t>(10'000 + us / 1000), 1513.5F));
    }
    return dir_.write("dive.tlog", log);
  }
  // 100 s of a DVL at 5 Hz, from `first_s` on.
  fs::path dvl_csv(double first_s = kStart_s) const {
    std::string csv = "time [s],v_x [cm/s],v_y [cm/s],v_z [cm/s],valid\n";
    for (int i = 0; i < 500; ++i) csv += fmt::format("{:.3f},25,0,0,1\n", first_s + 0.2 * i);
    return dir_.write("dvl.csv", csv);
  }
  // 10 s of the sensors of an ArduSub vehicle with a DVL, since it was switched on.
  fs::path dataflash_log() const {
    std::string log = dataflash_formats() + dataflash_parameter("VISO_POS_X", 0.25F) +
                      dataflash_parameter("VISO_POS_Y", 0.0F) +
                      dataflash_parameter("VISO_POS_Z", 0.125F);
    for (std::uint64_t us = 1'000'000; us < 11'000'000; us += 20'000) {
      log += dataflash_imu(us, 0, {0.0F, 0.0F, 0.0F, 0.0F, 0.0F, -9.81F});
      if (us % 100'000 == 0) log += dataflash_baro(us, 1, 151'350.0F);
      if (us % 200'000 == 0) log += dataflash_viso(us, 0.2F, {0.05F, 0.0F, 0.0F}, 90.0F);
    }
    return dir_.write("00000012.BIN", log);
  }

  TmpDir dir_;
};

TEST_F(SensorImportTest, AVideoGetsTheSensorsOfOtherFiles) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 20);
  ImportOptions options;
  options.sensors = {telemetry_log(), dvl_csv()};
  options.video_start = Stamp{(kStart_s + 30) * kSecond_ns};
  const ImportResult result = import_source(video, out(), options);
  EXPECT_EQ(result.images, 20U);
  EXPECT_NEAR(static_cast<double>(result.imu_samples), 50.0 * 11.9, 2.0);  // 5 s around the images
  EXPECT_NEAR(static_cast<double>(result.dvl_samples), 5.0 * 11.9, 2.0);
  const DatasetContents contents = dive();
  EXPECT_EQ(contents.delivered("camera"), 20U);
  EXPECT_EQ(contents.delivered("imu"), result.imu_samples);
  EXPECT_EQ(contents.delivered("pressure"), result.pressure_samples);
  EXPECT_EQ(contents.dropped("imu"), 0U);
  for (const SensorEvent& event : contents.events) {
    if (const auto* dvl = std::get_if<DvlSample>(&event)) {
      EXPECT_EQ(dvl->velocity.x(), 0.25);
    }
    if (const auto* image = std::get_if<ImageFrame>(&event)) {
      EXPECT_GE(image->stamp.ns, (kStart_s + 30) * kSecond_ns);
    }
  }
}

TEST_F(SensorImportTest, TheRigOfAnAutopilotIsForwardRightDown) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 5);
  ImportOptions options;
  options.sensors = {telemetry_log(), dvl_csv()};
  import_source(video, out(), options);
  const Rig r = rig();
  EXPECT_EQ(r.world, WorldFrame::ned);
  ASSERT_TRUE(r.imu && r.dvl && r.pressure);
  EXPECT_NEAR(r.imu->rate_hz, 50.0, 0.5);
  const SE3& camera = r.cameras.at(0).T_body_camera;
  EXPECT_TRUE((camera.rotation * Vector3d::UnitZ()).isApprox(Vector3d::UnitX()));  // forward
  EXPECT_TRUE((camera.rotation * Vector3d::UnitY()).isApprox(Vector3d::UnitZ()));  // down
  EXPECT_TRUE(r.dvl->T_body_dvl.rotation.isApprox(Eigen::Quaterniond::Identity()));
}

TEST_F(SensorImportTest, WithoutATimeTheVideoBeginsWithTheSensors) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 5);
  ImportOptions options;
  options.sensors = {dvl_csv(100.0)};
  import_source(video, out(), options);
  const auto images = read_dataset(config_for(out()), {"camera"}).events;
  EXPECT_EQ(stamp_of(images.at(0)).ns, 100 * kSecond_ns);
}

TEST_F(SensorImportTest, WithoutAnImuTheBodyIsTheCamera) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 5);
  ImportOptions options;
  options.sensors = {dvl_csv()};
  import_source(video, out(), options);
  const Rig r = rig();
  EXPECT_FALSE(r.imu);
  EXPECT_TRUE(r.cameras.at(0).T_body_camera.rotation.isApprox(Eigen::Quaterniond::Identity()));
  EXPECT_TRUE((r.dvl->T_body_dvl.rotation * Vector3d::UnitX()).isApprox(Vector3d::UnitZ()));
}

TEST_F(SensorImportTest, AGivenRigIsCompleted) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 5);
  ImportOptions options;
  options.sensors = {telemetry_log(), dvl_csv()};
  options.rig = dir_.write("my_rig.yaml",
                           "world: ned\nimu0: {rate_hz: 49}\ncam0:\n  intrinsics: [60, 60, 31.5, "
                           "23.5]\n  resolution: [64, 48]\n");
  import_source(video, out(), options);
  const Rig r = rig();
  EXPECT_EQ(r.imu->rate_hz, 49.0);
  EXPECT_TRUE(r.dvl && r.pressure);
}

TEST_F(SensorImportTest, AVideoOfAnotherTimeIsAnError) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 5);
  ImportOptions options;
  options.sensors = {dvl_csv()};
  options.video_start = Stamp{5 * kSecond_ns};
  EXPECT_THAT(input_error([&] { import_source(video, out(), options); }),
              HasSubstr("but the images are from 5.000 s"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(SensorImportTest, CreationTimeCountsWithinTheSensorsTime) {
  const SensorData sensors = read_sensor_file(dvl_csv());
  const Stamp within{(kStart_s + 50) * kSecond_ns};
  const Stamp outside{(kStart_s + 5000) * kSecond_ns};
  const auto no_gyro = []() -> GyroAlignment { throw std::logic_error("there is no gyro"); };
  EXPECT_EQ(video_start("clip.mp4", within, sensors, {}, no_gyro), within);
  EXPECT_EQ(video_start("clip.mp4", outside, sensors, {}, no_gyro).ns, kStart_s * kSecond_ns);
  ImportOptions by_gyro;
  by_gyro.video_start_by_gyro = true;
  EXPECT_THAT(input_error([&] { video_start("clip.mp4", within, sensors, by_gyro, no_gyro); }),
              HasSubstr("the sensors have no gyro"));
}

TEST_F(SensorImportTest, TheGyroCountsBeforeTheCreationTime) {
  const SensorData sensors = read_sensor_file(telemetry_log());
  const Stamp created{(kStart_s + 50) * kSecond_ns};
  const Stamp found{(kStart_s + 20) * kSecond_ns};
  const auto fits = [&] { return GyroAlignment{.start = found}; };
  const auto fails = [] { return GyroAlignment{.why_not = "the camera hardly turns"}; };
  EXPECT_EQ(video_start("clip.mp4", created, sensors, {}, fits), found);
  EXPECT_EQ(video_start("clip.mp4", created, sensors, {}, fails), created);
  EXPECT_EQ(video_start("clip.mp4", {}, sensors, {}, fails).ns, kStart_s * kSecond_ns);
  ImportOptions given;
  given.video_start = Stamp{(kStart_s + 7) * kSecond_ns};
  EXPECT_EQ(video_start("clip.mp4", created, sensors, given, fits), *given.video_start);
}

TEST_F(SensorImportTest, ALogAloneBecomesADataSet) {
  const ImportResult result = import_source(dataflash_log(), out(), {});
  EXPECT_EQ(result.kind, SourceKind::log);
  EXPECT_EQ(result.imu_samples, 500U);
  EXPECT_EQ(result.dvl_samples, 50U);
  EXPECT_FALSE(fs::exists(out() / "mav0/cam0"));
  const DatasetContents contents = dive();
  EXPECT_EQ(contents.delivered("imu"), 500U);
  EXPECT_EQ(contents.delivered("dvl"), 50U);
  const Rig r = rig();
  EXPECT_TRUE(r.dvl->T_body_dvl.translation.isApprox(Vector3d(0.25, 0.0, 0.125)));
  EXPECT_EQ(read_notes(out())->kind, "log");
}

TEST_F(SensorImportTest, ASensorOfALaterFileReplacesThatOfTheLog) {
  ImportOptions options;
  options.sensors = {dvl_csv(1.0)};
  const ImportResult result = import_source(dataflash_log(), out(), options);
  EXPECT_EQ(result.imu_samples, 500U);
  EXPECT_EQ(result.dvl_samples, 500U);
}

TEST_F(SensorImportTest, FilesOfDifferentClocksAreAnError) {
  ImportOptions options;
  options.sensors = {dvl_csv()};
  EXPECT_THAT(input_error([&] { import_source(dataflash_log(), out(), options); }),
              HasSubstr("all files must have the same clock: a .BIN log without GNSS counts from "
                        "when the autopilot was switched on; take the .tlog"));
}

TEST_F(SensorImportTest, FilesWithoutSensorsAreErrors) {
  const std::pair<fs::path, const char*> files[] = {
      {dir_.path() / "nothing.csv", "no such file"},
      {dir_.write("empty.tlog", ""), "no samples of an IMU"},
      {dir_.write("other.csv", "time [s],temperature\n1,2\n"), "no samples of an IMU"},
      {dir_.write("dive.txt", "x"), "not a file of sensors"}};
  for (const auto& [path, message] : files) {
    EXPECT_THAT(input_error([&] { read_sensor_file(path); }), HasSubstr(message));
  }
}

TEST_F(SensorImportTest, OptionsWithoutEffectAreErrors) {
  ImportOptions start;
  start.video_start = Stamp{1};
  ImportOptions lens;
  lens.fov_deg = 60.0;
  for (const ImportOptions& options : {start, lens}) {
    EXPECT_NE(input_error([&] { import_source(dataflash_log(), out(), options); }), "");
  }
}

TEST(BodyAxes, AreThoseThatGravityShows) {
  SensorData data;
  EXPECT_EQ(body_axes(data, true), BodyAxes::camera);
  EXPECT_EQ(body_axes(data, false), BodyAxes::forward_right_down);
  data.imu = {{Stamp{1}, Vector3d::Zero(), Vector3d(0.5, 0.0, 9.8)}};
  EXPECT_EQ(body_axes(data, true), BodyAxes::forward_left_up);
  data.imu[0].accel.z() = -9.8;
  EXPECT_EQ(body_axes(data, true), BodyAxes::forward_right_down);
}

}  // namespace
}  // namespace apvi::importer
