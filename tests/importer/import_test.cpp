// SPDX-License-Identifier: BSD-3-Clause
#include "importer/import.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/sensors/rig.hpp"
#include "importer/dive_writer.hpp"
#include "importer/source_files.hpp"
#include "io/dataset_builder.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using testing::HasSubstr;
namespace fs = std::filesystem;

#define NEEDS_VIDEO(path, images) \
  if (!write_video(path, images)) GTEST_SKIP() << "this OpenCV cannot write videos"

class ImportTest : public testing::Test {
 protected:
  fs::path out() const { return dir_.path() / "dive"; }
  std::vector<SensorEvent> events(const std::vector<std::string>& sensors) const {
    return read_dataset(config_for(out()), sensors).events;
  }
  Rig rig() const { return make_rig(config::load_file(out() / "rig.yaml")); }
  std::string import_error(const fs::path& source, const ImportOptions& options = {}) const {
    return input_error([&] { import_source(source, out(), options); });
  }

  TmpDir dir_;
};

TEST_F(ImportTest, VideoWithoutTelemetryBecomesImages) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 10);
  const ImportResult result = import_source(video, out(), {});
  EXPECT_EQ(result.kind, SourceKind::video);
  EXPECT_TRUE(result.assumed_camera);
  const auto images = events({"camera"});
  ASSERT_EQ(images.size(), 10U);
  EXPECT_NEAR(seconds_between(stamp_of(images[0]), stamp_of(images[9])), 0.9, 1e-6);
  const cv::Mat last = std::get<ImageFrame>(images[9]).decode();
  EXPECT_EQ(last.size(), cv::Size(64, 48));
  EXPECT_NEAR(cv::mean(last)[0], 65.0, 4.0);
  EXPECT_EQ(rig().cameras.front().model.parameters().width, 64);
  EXPECT_FALSE(rig().imu.has_value());
}

TEST_F(ImportTest, ImagesAreSelectedAndScaled) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 20);
  ImportOptions options;
  options.every = 3;
  options.images.scale = 0.5;
  options.images.png = true;
  EXPECT_EQ(import_source(video, out(), options).images, 7U);
  EXPECT_EQ(std::get<ImageFrame>(events({"camera"})[0]).decode().size(), cv::Size(32, 24));
  options = {};
  options.fps = 5.0;
  options.start_s = 0.5;
  options.duration_s = 1.0;
  options.overwrite = true;
  const ImportResult result = import_source(video, out(), options);
  EXPECT_EQ(result.images, 5U);
  EXPECT_NEAR(result.length_s, 0.8, 1e-6);
}

TEST_F(ImportTest, TelemetryBecomesImuAndExposure) {
  const fs::path plain = dir_.path() / "plain.mp4";
  NEEDS_VIDEO(plain, 20);
  const fs::path video = dir_.write(
      "gopro.mp4", with_telemetry(read_file(plain), {payload_at_rest(7), payload_at_rest(8)}));
  const ImportResult result = import_source(video, out(), {});
  EXPECT_EQ(result.imu_samples, 40U);
  const auto imu = events({"imu"});
  ASSERT_EQ(imu.size(), 40U);
  const auto& first = std::get<ImuSample>(imu.front());
  EXPECT_LT((first.accel - Eigen::Vector3d(0.0, -9.81, 0.0)).norm(), 1e-9);
  EXPECT_LT((first.gyro - Eigen::Vector3d(-0.02, -0.01, -0.03)).norm(), 1e-9);
  EXPECT_EQ(first.stamp, stamp_of(events({"camera"}).front()));
  EXPECT_THAT(read_file(out() / "mav0/exposure0/data.csv"), HasSubstr("shutter [s],iso"));
  EXPECT_NEAR(rig().imu->rate_hz, 20.0, 0.5);
  EXPECT_THAT(read_file(out() / "rig.yaml"), HasSubstr("ASSUMED"));
  EXPECT_EQ(read_notes(out())->imu_samples, 40U);
}

TEST_F(ImportTest, GivenRigReplacesTheAssumedOne) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 3);
  ImportOptions options;
  options.rig =
      dir_.write("mine.yaml", "cam0: {intrinsics: [50, 50, 31.5, 23.5], resolution: [64, 48]}\n");
  EXPECT_FALSE(import_source(video, out(), options).assumed_camera);
  EXPECT_EQ(rig().cameras.front().model.parameters().fx, 50.0);
  options.images.scale = 0.5;
  options.overwrite = true;
  EXPECT_THAT(import_error(video, options), HasSubstr("but the images are 32 x 24"));
}

TEST_F(ImportTest, InterruptedImportLeavesNothing) {
  const fs::path video = dir_.path() / "clip.avi";
  NEEDS_VIDEO(video, 10);
  ImportOptions options;
  int polls = 0;
  options.interrupted = [&polls] { return ++polls > 4; };
  EXPECT_TRUE(import_source(video, out(), options).interrupted);
  EXPECT_FALSE(fs::exists(out()));
  EXPECT_FALSE(fs::exists(out().string() + ".partial"));
}

TEST_F(ImportTest, ErrorsNameTheSource) {
  EXPECT_THAT(import_error("/nowhere/clip.mp4"), HasSubstr("/nowhere/clip.mp4: no such file"));
  EXPECT_THAT(import_error(dir_.write("notes.txt", "hello")), HasSubstr("not a video"));
  EXPECT_THAT(import_error(dir_.write("broken.avi", "hello")), HasSubstr("not a video that"));
  EXPECT_THAT(import_error(dir_.write("cut.mp4", box("ftyp", "mp42") + box("mdat", "x"))),
              HasSubstr("has no index"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(ImportTest, OptionsOfAnotherKindOfSourceAreErrors) {
  write_photo(dir_, "photos/a.png");
  ImportOptions every;
  every.every = 2;
  EXPECT_THAT(import_error(dir_.path() / "photos", every), HasSubstr("only for a video"));
  ImportOptions unit;
  unit.meters_per_unit = 0.1;
  EXPECT_THAT(import_error(dir_.path() / "photos", unit),
              HasSubstr("only for a COLMAP or Metashape model"));
  dir_.write("model/cameras.txt", "");
  dir_.write("model/images.txt", "");
  ImportOptions view;
  view.fov_deg = 60.0;
  EXPECT_THAT(import_error(dir_.path() / "model", view), HasSubstr("has its own calibration"));
}

TEST_F(ImportTest, ReplacesOnlyWhatAnImportHasMade) {
  write_photo(dir_, "photos/a.png");
  ImportOptions options;
  options.overwrite = true;
  dir_.write("dive/precious.txt", "x");
  EXPECT_THAT(import_error(dir_.path() / "photos", options), HasSubstr("not made by"));
  fs::remove(out() / "precious.txt");
  import_source(dir_.path() / "photos", out(), options);
  EXPECT_THAT(import_error(dir_.path() / "photos"), HasSubstr("use --overwrite"));
  import_source(dir_.path() / "photos", out(), options);
}

TEST_F(ImportTest, PhotographsAreInNaturalOrderAndASecondApart) {
  for (const int i : {10, 9, 1}) write_photo(dir_, fmt::format("photos/img{}.png", i), 10 * i);
  write_photo(dir_, "photos/img11.png", 99, {8, 8});
  dir_.write("photos/img12.jpg", "no image");
  EXPECT_EQ(import_source(dir_.path() / "photos", out(), {}).images, 3U);
  const auto images = events({"camera"});
  ASSERT_EQ(images.size(), 3U);
  EXPECT_EQ(cv::mean(std::get<ImageFrame>(images[2]).decode())[0], 100.0);
  EXPECT_EQ(seconds_between(stamp_of(images[0]), stamp_of(images[2])), 2.0);
}

TEST_F(ImportTest, PhotographsOfTheUsualSizeAreTaken) {
  write_photo(dir_, "photos/img0.png", 99, {8, 8});  // a thumbnail
  for (const int i : {1, 2, 3}) write_photo(dir_, fmt::format("photos/img{}.png", i), 10 * i);
  EXPECT_EQ(import_source(dir_.path() / "photos", out(), {}).images, 3U);
  EXPECT_EQ(cv::mean(std::get<ImageFrame>(events({"camera"})[0]).decode())[0], 10.0);
}

TEST_F(ImportTest, NamesOfPhotographsMayBeStamps) {
  for (const char* ns : {"1700000000500000000", "1700000000000000000"}) {
    write_photo(dir_, fmt::format("photos/{}.png", ns));
  }
  import_source(dir_.path() / "photos", out(), {});
  EXPECT_EQ(stamp_of(events({"camera"})[1]).ns, 1'700'000'000'500'000'000);
}

TEST(DiveWriter, KeepsAnotherFolderOfItsTemporaryName) {
  const TmpDir dir;
  dir.write("dive.partial/precious.txt", "x");
  EXPECT_THAT(input_error([&] { DiveWriter(dir.path() / "dive", false); }),
              HasSubstr("dive.partial: is in the way"));
  EXPECT_TRUE(fs::exists(dir.path() / "dive.partial/precious.txt"));
}

TEST(DiveWriter, ImageThatCannotBeWrittenIsAnError) {
  const TmpDir dir;
  DiveWriter dive(dir.path() / "dive", false);
  fs::create_directories(dir.path() / "dive.partial/mav0/cam0/data/7.png");  // cannot be opened
  EXPECT_THROW(dive.add_image(Stamp{7}, ".png", as_bytes("x")), RunError);
}

}  // namespace
}  // namespace apvi::importer
