// SPDX-License-Identifier: BSD-3-Clause
// Videos whose start on the clock of a gyro is known: of a camera along a spline over a floor, and
// of a GoPro with its own gyro.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/videoio.hpp>

#include "importer/alignment/video_alignment.hpp"
#include "importer/dive_writer.hpp"
#include "importer/import.hpp"
#include "importer/mp4.hpp"
#include "importer/source_files.hpp"
#include "importer/telemetry.hpp"
#include "io/dataset_builder.hpp"
#include "io/folder/csv_rows.hpp"
#include "support/spline_imu.hpp"
#include "support/test_data.hpp"
#include "support/textured_floor.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using Eigen::Vector3d;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr double kLog_s = 150.0;
constexpr double kClip_s = 20.0;
constexpr double kFps = 10.0;
constexpr Duration kToUnix{1'700'000'000'000'000'000};

// Above one place of the floor, with turns about all axes.
Se3Spline spline_over_floor(std::uint64_t seed) {
  Random random(seed);
  std::vector<SE3> control;
  double yaw = 0.0;
  for (double t = 0.0; t < kLog_s + 6.0; t += 1.0) {
    yaw += random.uniform(-0.3, 0.3);
    const Vector3d tilt(random.uniform(-0.15, 0.15), random.uniform(-0.15, 0.15), 0.0);
    control.push_back({so3::exp({0.0, 0.0, yaw}) * so3::exp(tilt),
                       Vector3d(0.0, 0.0, 2.5) + random_vector(random, 0.5)});
  }
  return Se3Spline(Stamp{1'000'000'000}, Duration::from_seconds(1.0), std::move(control));
}

std::vector<ImuSample> imu_of(const Se3Spline& spline) {
  std::vector<ImuSample> imu = imu_along(spline, {0.0, 0.0, -9.80665}, 100.0);
  Random random(4);
  for (ImuSample& sample : imu) {
    sample.stamp = sample.stamp + kToUnix;
    sample.gyro += Vector3d(0.01, -0.02, 0.015) + normal_vector(random, 0.003);
    sample.accel += normal_vector(random, 0.02);
  }
  return imu;
}

class VideoAlignmentTest : public testing::Test {
 protected:
  fs::path clip() const { return dir_.path() / "clip.avi"; }
  fs::path out() const { return dir_.path() / "dive"; }

  // The floor from `at_s` of the spline on, by a camera whose mounting is not that of a rig.
  bool write_clip(const Se3Spline& spline, double at_s, bool moves = true) const {
    const SE3 T_body_camera{so3::exp({std::numbers::pi, 0.0, 0.0}) * so3::exp({0.2, 0.1, 0.9}),
                            {0.1, 0.0, -0.05}};
    cv::VideoWriter writer(clip().string(), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), kFps,
                           {320, 240});
    if (!writer.isOpened()) return false;
    cv::RNG noise(5);
    for (int i = 0; i < static_cast<int>(kFps * kClip_s); ++i) {
      const double t = at_s + (moves ? i / kFps : 0.0);
      const SE3 T_world_body = spline.at(spline.start() + Duration::from_seconds(t)).T_world_body;
      cv::Mat image = render_floor(T_world_body * T_body_camera);
      cv::Mat grain(image.size(), CV_8U);
      noise.fill(grain, cv::RNG::UNIFORM, 0, 8);
      cv::Mat color;
      cv::cvtColor(image + grain, color, cv::COLOR_GRAY2BGR);
      writer.write(color);
    }
    return true;
  }

  fs::path write_imu(const std::vector<ImuSample>& imu) const {
    std::string csv(io::kImuCsvHeader);
    for (const ImuSample& sample : imu) csv += '\n' + io::csv_row(sample, io::kExactDigits);
    return dir_.write("imu.csv", csv + '\n');
  }

  Stamp first_image() const {
    return stamp_of(read_dataset(config_for(out()), {"camera"}).events.at(0));
  }

  TmpDir dir_;
};

TEST_F(VideoAlignmentTest, TheGyroTellsWhenAVideoBegins) {
  constexpr double kAt_s = 80.237;
  const Se3Spline spline = spline_over_floor(7);
  if (!write_clip(spline, kAt_s)) GTEST_SKIP() << "this OpenCV cannot write videos";
  ImportOptions options;
  options.sensors = {write_imu(imu_of(spline))};
  options.fov_deg = 74.0;
  const Stamp truth = spline.start() + Duration::from_seconds(kAt_s) + kToUnix;
  import_source(clip(), out(), options);
  EXPECT_NEAR(seconds_between(truth, first_image()), 0.0, 0.01);
  // The time is that of the first image of the file, also if the import begins later.
  options.start_s = 6.0;
  options.overwrite = true;
  import_source(clip(), out(), options);
  EXPECT_NEAR(seconds_between(truth, first_image()), 6.0, 0.01);
}

TEST_F(VideoAlignmentTest, AStillVideoIsRefused) {
  const Se3Spline spline = spline_over_floor(7);
  if (!write_clip(spline, 80.0, /*moves=*/false)) GTEST_SKIP() << "this OpenCV cannot write videos";
  ImportOptions options;
  options.sensors = {write_imu(imu_of(spline))};
  options.video_start_by_gyro = true;
  const std::string error = input_error([&] { import_source(clip(), out(), options); });
  EXPECT_THAT(error, HasSubstr("the camera hardly turns"));
  EXPECT_THAT(error, HasSubstr("--video-start"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(VideoAlignmentTest, AVideoOfAnotherDiveIsRefused) {
  if (!write_clip(spline_over_floor(8), 80.0)) GTEST_SKIP() << "this OpenCV cannot write videos";
  ImportOptions options;
  options.sensors = {write_imu(imu_of(spline_over_floor(7)))};
  options.video_start_by_gyro = true;
  EXPECT_THAT(input_error([&] { import_source(clip(), out(), options); }),
              HasSubstr("fits no time clearly best"));
}

// Its gyro as that of another device, on another clock.
TEST_F(VideoAlignmentTest, AGoProIsFoundInItsOwnGyro) {
  APVI_NEEDS_DATA(video, "reef_gopro/reef_clip.mp4");
  // By which the images are late if the first one has the time of the first sample: its rig.yaml.
  constexpr double kDelay_s = 0.105;
  const auto telemetry = read_telemetry(video, read_mp4(video));
  ASSERT_TRUE(telemetry);
  const auto stamp = [](double time_s) {
    return Stamp{} + kToUnix + Duration::from_seconds(time_s);
  };
  std::vector<ImuSample> imu;
  for (const ImuRow& row : telemetry->imu)
    imu.push_back({stamp(80.0 + row.time_s), row.gyro, row.accel});
  const Stamp truth = stamp(80.0 - kDelay_s);
  for (const bool has_date : {false, true}) {
    const auto created = has_date ? std::optional(stamp(200.0)) : std::nullopt;
    const GyroAlignment found = align_video(video, {}, std::nullopt, created, imu);
    ASSERT_TRUE(found.start) << found.why_not;
    EXPECT_NEAR(seconds_between(truth, *found.start), 0.0, 0.01);
    EXPECT_LT(found.sigma_s, 0.01);
    EXPECT_GT(found.correlation, found.elsewhere);
  }
}

}  // namespace
}  // namespace apvi::importer
