// SPDX-License-Identifier: BSD-3-Clause
// A real recording of a GoPro with a reconstruction by COLMAP.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "apvi/config/node.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/rig.hpp"
#include "importer/colmap_model.hpp"
#include "importer/dive_writer.hpp"
#include "importer/import.hpp"
#include "importer/mp4.hpp"
#include "importer/telemetry.hpp"
#include "io/dataset_builder.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::importer {
namespace {

using test::config_for;
using test::read_dataset;
using test::TmpDir;

TEST(Reef, ImportHasTheImagesAndTheImuOfTheContainer) {
  APVI_NEEDS_DATA(clip, "reef_gopro/reef_clip.mp4");
  const TmpDir dir;
  const auto out = dir.path() / "dive";
  ImportOptions options;
  options.images.scale = 0.25;
  const ImportResult result = import_source(clip, out, options);
  const Mp4Movie movie = read_mp4(clip);
  const Mp4Track& video = *movie.with_handler("vide");
  EXPECT_EQ(result.images, video.samples.size());
  EXPECT_NEAR(result.length_s, static_cast<double>(result.images - 1) * 1001.0 / 30000.0, 1e-3);
  const auto images = read_dataset(config_for(out), {"camera"}).events;
  EXPECT_NEAR(seconds_between(kWithoutDate, stamp_of(images[0])), video.first_s(), 1e-6);
  const Mp4Track& telemetry = *movie.with_format("gpmd");
  const auto imu = read_dataset(config_for(out), {"imu"}).events;
  EXPECT_NEAR(seconds_between(stamp_of(imu.front()), stamp_of(imu.back())),
              1.001 * static_cast<double>(telemetry.samples.size()), 0.02);
  EXPECT_NEAR(make_rig(config::load_file(out / "rig.yaml")).imu->rate_hz, 199.3, 0.5);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const SensorEvent& e : imu) mean += std::get<ImuSample>(e).accel;
  mean /= static_cast<double>(imu.size());
  EXPECT_NEAR(mean.norm(), 9.81, 0.3);
  EXPECT_LT(mean.y(), -8.0);  // the camera is about level: gravity is along y
}

// The clip does not tell its lens, and the wide mode is wrong by 7 degrees there.
TEST(Reef, ImagesTellThatTheLensIsLinear) {
  APVI_NEEDS_DATA(folder, "reef_gopro");
  const TmpDir dir;
  const auto out = dir.path() / "dive";
  import_source(folder / "reef_clip.mp4", out, {});
  const auto camera = [](const std::filesystem::path& rig) {
    return make_rig(config::load_file(rig)).cameras.front().model;
  };
  const CameraModel found = camera(out / "rig.yaml");
  const CameraModel colmap = camera(folder / "rig.yaml");
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(40.0, 120.0), Eigen::Vector2d(800.0, 500.0)}) {
    const Eigen::Vector2d same = 2.0 * pixel + Eigen::Vector2d(0.5, 0.5);  // COLMAP's are halved
    const Eigen::Vector3d a = *found.unproject(same);
    const Eigen::Vector3d b = *colmap.unproject(pixel);
    EXPECT_LT(std::acos(a.normalized().dot(b.normalized())), 0.04);
  }
}

// Rotation of the body from one time to another by the gyro.
Eigen::Quaterniond integrate(const std::vector<ImuRow>& imu, double from_s, double to_s) {
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  for (std::size_t i = 0; i + 1 < imu.size(); ++i) {
    const double dt = std::min(to_s, imu[i + 1].time_s) - std::max(from_s, imu[i].time_s);
    const Eigen::Vector3d step = 0.5 * (imu[i].gyro + imu[i + 1].gyro) * std::max(0.0, dt);
    q = q * so3::exp(step);
  }
  return q;
}

TEST(Reef, GyroTurnsAsTheCameraOfTheReconstruction) {
  APVI_NEEDS_DATA(folder, "reef_gopro");
  constexpr double kDelay_s = 0.105;  // of the images' stamps, as its rig.yaml says
  constexpr std::size_t kStep = 15;   // images
  const auto telemetry =
      read_telemetry(folder / "reef_clip.mp4", read_mp4(folder / "reef_clip.mp4"));
  ASSERT_TRUE(telemetry);
  const ColmapModel model = read_colmap_model(folder / "colmap");
  const auto time = [](const ColmapImage& image) {
    return 1e-9 * static_cast<double>(std::stoll(image.name) - 1'000'000'000'000'000'000) -
           kDelay_s;
  };
  double turned = 0.0;
  double missed = 0.0;
  for (std::size_t i = kStep; i + kStep < model.images.size(); i += kStep) {
    const ColmapImage& a = model.images[i];
    const ColmapImage& b = model.images[i + kStep];
    const Eigen::Quaterniond seen =
        a.T_camera_world.rotation * b.T_camera_world.rotation.conjugate();
    turned += seen.angularDistance(Eigen::Quaterniond::Identity());
    missed += seen.angularDistance(integrate(telemetry->imu, time(a), time(b)));
  }
  EXPECT_GT(turned, 0.1);
  EXPECT_LT(missed, 0.4 * turned);  // other axes miss more than they turn
}

TEST(Reef, TelemetryIsThatOfOtherTools) {
  APVI_NEEDS_DATA(clip, "reef_gopro/reef_clip.mp4");
  const auto telemetry = read_telemetry(clip, read_mp4(clip));
  ASSERT_TRUE(telemetry);
  EXPECT_EQ(telemetry->device, "HERO10 Black");
  ASSERT_NEAR(static_cast<double>(telemetry->imu.size()), 1395.0, 5.0);
  // The first row of the recording's imu0, which was made with other tools.
  const ImuRow& first = telemetry->imu.front();
  EXPECT_LT((first.gyro - Eigen::Vector3d(0.0244941, -0.0138445, 0.0212993)).norm(), 1e-6);
  EXPECT_LT((first.accel - Eigen::Vector3d(-0.4820144, -9.4556355, -3.5659472)).norm(), 1e-6);
  EXPECT_NEAR(static_cast<double>(telemetry->exposure.size()), 210.0, 2.0);
  EXPECT_NEAR(*telemetry->exposure.front().iso, 128.0, 0.5);
}

TEST(Reef, ColmapModelIsComplete) {
  APVI_NEEDS_DATA(folder, "reef_gopro/colmap");
  const ColmapModel model = read_colmap_model(folder);
  EXPECT_EQ(model.images.size(), 211U);
  EXPECT_GT(model.points.size(), 1000U);
  EXPECT_NEAR(to_camera(model.cameras.begin()->second, "cameras.txt").fx, 669.2, 0.1);
}

}  // namespace
}  // namespace apvi::importer
