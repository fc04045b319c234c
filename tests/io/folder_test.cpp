// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "apvi/core/error.hpp"
#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using io::DropReason;
using test::config_for;
using test::imu_row;
using test::imu_rows;
using test::input_error;
using test::kDvlHeader;
using test::kImuHeader;
using test::read_dataset;
using test::TmpDir;
using testing::HasSubstr;

std::vector<std::int64_t> stamps_ms(const test::DatasetContents& out) {
  std::vector<std::int64_t> stamps;
  for (const auto& event : out.events) stamps.push_back(stamp_of(event).ns / 1'000'000);
  return stamps;
}

TEST(DatasetFolder, MergesSensorsChronologically) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) + imu_rows({1.0, 1.2, 1.4}));
  dir.write("mav0/depth0/data.csv", "#timestamp [ns],depth [m]\n1100000000,2.5\n1300000000,2.6\n");
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(stamps_ms(out), testing::ElementsAre(1000, 1100, 1200, 1300, 1400));
  EXPECT_EQ(out.delivered("imu"), 3U);
  EXPECT_EQ(out.delivered("depth"), 2U);
  EXPECT_DOUBLE_EQ(std::get<PressureDepthSample>(out.events[1]).depth_m, 2.5);
  EXPECT_EQ(std::get<ImuSample>(out.events[0]).gyro, Eigen::Vector3d(0.1, 0.2, 0.3));
}

TEST(DatasetFolder, FindsColumnsByName) {
  const TmpDir dir;
  test::write_imu(dir, "#timestamp [ns],a_z,a_y,a_x,w_x,w_z,w_y\n5,6,5,4,1,3,2\n");
  const auto out = read_dataset(config_for(dir.path()));
  ASSERT_EQ(out.events.size(), 1U);
  EXPECT_EQ(std::get<ImuSample>(out.events[0]).gyro, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(std::get<ImuSample>(out.events[0]).accel, Eigen::Vector3d(4, 5, 6));
}

TEST(DatasetFolder, AcceptsByteOrderMarkCrlfBlankAndCommentLines) {
  const TmpDir dir;
  test::write_imu(dir,
                  "\xEF\xBB\xBF#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\r\n10,1,2,3,4,5,6\r\n"
                  "\r\n# a remark\r\n20,1,2,3,4,5,6,\r\n30,1,2,3,4,5,6");
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.delivered("imu"), 3U);
  EXPECT_EQ(out.dropped("imu"), 0U);
}

TEST(DatasetFolder, CountsUnusableSamplesByReason) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) + imu_rows({1.0, 1.1}) +
                           "1150000000,nan,0,0,0,0,0\n1160000000,0,0,0,0,inf,0\n"  // not finite
                           "1170000000,0,0,0,x,0,0\nhello,0,0,0,0,0,0\n-5,0,0,0,0,0,0\n"
                           "1180000000,0,0,0\n1190000000,,0,0,0,0,0\n"  // malformed
                           + imu_rows({1.1, 1.05, 1.2}) + "1300000000,0,0");
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(stamps_ms(out), testing::ElementsAre(1000, 1100, 1200));
  EXPECT_EQ(out.dropped("imu", DropReason::not_finite), 2U);
  EXPECT_EQ(out.dropped("imu", DropReason::malformed), 6U);
  EXPECT_EQ(out.dropped("imu", DropReason::duplicate_stamp), 1U);
  EXPECT_EQ(out.dropped("imu", DropReason::out_of_order), 1U);
  EXPECT_EQ(out.dropped("imu", DropReason::broken_stamp), 0U);
  EXPECT_THAT(out.report.at("imu").first_drop.at(DropReason::malformed),
              HasSubstr("mav0/imu0/data.csv:6"));
}

TEST(DatasetFolder, DropsIsolatedStampJumps) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) +
                           imu_rows({5000.0, 5000.1, 8600.0, 5000.2, 1400.0, 5000.3, 5000.4}));
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(stamps_ms(out), testing::ElementsAre(5000000, 5000100, 5000200, 5000300, 5000400));
  EXPECT_EQ(out.dropped("imu", DropReason::broken_stamp), 2U);
  EXPECT_EQ(out.dropped("imu"), 2U);
}

TEST(DatasetFolder, DropsBrokenFirstOrLastStamp) {
  const TmpDir dir;
  for (const double first : {0.0, 90000.0}) {
    test::write_imu(dir, std::string(kImuHeader) + imu_rows({first, 5000.1, 5000.2, 90000.0}));
    const auto out = read_dataset(config_for(dir.path()));
    EXPECT_THAT(stamps_ms(out), testing::ElementsAre(5000100, 5000200)) << first;
    EXPECT_EQ(out.dropped("imu", DropReason::broken_stamp), 2U) << first;
  }
}

TEST(DatasetFolder, KeepsSamplesAfterGap) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) + imu_rows({1.0, 1.1, 3601.0, 3601.1, 3601.2}));
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.delivered("imu"), 5U);
  EXPECT_EQ(out.dropped("imu"), 0U);
}

TEST(DatasetFolder, ContinuesAfterTheClockWasSetBack) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) +
                           imu_rows({5000.0, 5000.1, 5000.2, 1400.0, 1400.1, 1400.2, 1400.3}));
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(stamps_ms(out),
              testing::ElementsAre(5000000, 5000100, 5000200, 5010200, 5010300, 5010400, 5010500));
  EXPECT_EQ(out.dropped("imu"), 0U);
}

TEST(DatasetFolder, AcceptsFileWithHeaderOnly) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) + imu_rows({1.0}));
  dir.write("mav0/dvl0/data.csv", kDvlHeader);
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.events.size(), 1U);
  EXPECT_EQ(out.delivered("dvl"), 0U);
}

TEST(DatasetFolder, DeliversInvalidDvlSamples) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv", std::string(kDvlHeader) +
                                      "10,nan,nan,nan,,-1,0,,,,,,,,,,,,\n"
                                      "20,,,,,,0,0,0.1,,,-1,9.5,,,0,1,,\n"
                                      "30,1,2,3,0.01,8.5,1,,,,,,,,,,,,\n"
                                      "40,,2,3,0.01,8.5,1,,,,,,,,,,,,\n"
                                      "50,1,2,3,0.01,8.5,2,,,,,,,,,,,,\n");
  const auto out = read_dataset(config_for(dir.path()));
  ASSERT_EQ(out.events.size(), 3U);
  EXPECT_EQ(out.dropped("dvl", DropReason::malformed), 2U);
  const auto& first = std::get<DvlSample>(out.events[0]);
  EXPECT_FALSE(first.valid);
  EXPECT_EQ(first.velocity, Eigen::Vector3d::Zero());
  EXPECT_FALSE(first.altitude);
  const auto& second = std::get<DvlSample>(out.events[1]);
  ASSERT_TRUE(second.beams[0] && second.beams[1]);
  EXPECT_FALSE(second.beams[0]->valid);
  EXPECT_FALSE(second.beams[0]->range);
  EXPECT_DOUBLE_EQ(second.beams[1]->range.value(), 9.5);
  EXPECT_FALSE(second.beams[2]);
  const auto& third = std::get<DvlSample>(out.events[2]);
  EXPECT_TRUE(third.valid);
  EXPECT_EQ(third.velocity, Eigen::Vector3d(1, 2, 3));
  EXPECT_DOUBLE_EQ(third.figure_of_merit.value(), 0.01);
}

TEST(DatasetFolder, ConvertsPressureToPascal) {
  const TmpDir dir;
  const auto pressure = [&](const std::string& column, double value, io::PressureUnit unit) {
    dir.write("mav0/pressure0/data.csv", fmt::format("#timestamp [ns],{}\n1,{}\n", column, value));
    auto config = config_for(dir.path());
    config.pressure_unit = unit;
    return std::get<PressureSample>(read_dataset(config).events.at(0)).pressure_pa;
  };
  using enum io::PressureUnit;
  EXPECT_DOUBLE_EQ(pressure("pressure [Pa]", 103000, automatic), 103000);
  EXPECT_DOUBLE_EQ(pressure("pressure [hPa]", 60000, automatic), 6e6);
  EXPECT_DOUBLE_EQ(pressure("pressure", 103000, automatic), 103000);
  EXPECT_DOUBLE_EQ(pressure("pressure", 1030, automatic), 103000);
  EXPECT_DOUBLE_EQ(pressure("pressure", 103, automatic), 103000);
  EXPECT_DOUBLE_EQ(pressure("pressure [Pa]", 1030, kpa), 1.03e6);
  EXPECT_DOUBLE_EQ(pressure("pressure [psi]", 15.0, automatic), 15.0 * 6894.757293168);
  EXPECT_DOUBLE_EQ(pressure("pressure [psi]", 10.5, dbar), 1.05e5);
}

TEST(DatasetFolder, DecodesImagesOnDemand) {
  const TmpDir dir;
  dir.write("mav0/cam0/data.csv",
            "#timestamp [ns],filename\n1,good.png\n2,missing.png\n3,broken.png\n");
  std::filesystem::create_directories(dir.path() / "mav0/cam0/data");
  cv::imwrite((dir.path() / "mav0/cam0/data/good.png").string(), cv::Mat(4, 6, CV_8UC1, {77}));
  dir.write("mav0/cam0/data/broken.png", "no image");
  const auto out = read_dataset(config_for(dir.path()));
  ASSERT_EQ(out.events.size(), 2U);
  EXPECT_EQ(out.dropped("camera", DropReason::malformed), 1U);
  const cv::Mat image = std::get<ImageFrame>(out.events[0]).decode();
  EXPECT_EQ(image.size(), cv::Size(6, 4));
  EXPECT_EQ(image.at<unsigned char>(1, 1), 77);
  EXPECT_THROW(std::get<ImageFrame>(out.events[1]).decode(), RunError);
}

TEST(DatasetFolder, FindsImagesThatWereMovedOrConverted) {
  const TmpDir dir;
  dir.write(
      "mav0/cam0/data.csv",
      "#timestamp [ns],filename\n1,data/a.png\n2,data\\a.png\n3,/recorder/dive/a.png\n4,b.png\n"
      "5,c.png\n");
  dir.write("mav0/cam0/data/a.png", "not decoded");
  dir.write("mav0/cam0/data/b.jpg", "not decoded");
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.delivered("camera"), 4U);
  EXPECT_EQ(out.dropped("camera", DropReason::malformed), 1U);
}

TEST(DatasetFolder, AppliesConfiguredSpanAndBlackout) {
  const TmpDir dir;
  std::string rows;
  std::string images = "#timestamp [ns],filename\n";
  for (int i = 0; i < 100; ++i) {
    rows += imu_row(7'000'000'000 + i * 100'000'000LL);
    images += fmt::format("{},a.png\n", 7'000'000'000 + i * 100'000'000LL);
  }
  test::write_imu(dir, kImuHeader + rows);
  dir.write("mav0/cam0/data.csv", images);
  dir.write("mav0/cam0/data/a.png", "never decoded");
  auto config = config_for(dir.path());
  config.start_s = 2.0;
  config.duration_s = 3.0;
  config.blackout_s = {{2.5, 3.0}, {4.0, 4.1}};
  config.blackout_mode = io::Blackout::dropped;
  const auto out = read_dataset(config);
  EXPECT_EQ(out.delivered("imu"), 30U);
  EXPECT_EQ(out.delivered("camera"), 24U);
  EXPECT_EQ(stamp_of(out.events.front()).ns, 9'000'000'000);
  EXPECT_EQ(stamp_of(out.events.back()).ns, 11'900'000'000);
}

TEST(DatasetFolder, ReadsOnlyRequestedSensors) {
  const TmpDir dir;
  test::write_imu(dir, std::string(kImuHeader) + imu_rows({1.0}));
  dir.write("mav0/depth0/data.csv", "#timestamp [ns],depth [m]\n1,2.5\n");
  dir.write("mav0/gnss0/data.csv", "#timestamp [ns],east [m],north [m],up [m]\n1,2,3,0\n");
  EXPECT_EQ(read_dataset(config_for(dir.path()), {"imu"}).events.size(), 1U);
  EXPECT_EQ(read_dataset(config_for(dir.path()), {"imu", "pressure"}).events.size(), 2U);
  EXPECT_EQ(read_dataset(config_for(dir.path())).events.size(), 3U);
}

TEST(DatasetFolder, ErrorsAreOneLine) {
  const TmpDir dir;
  const auto error = [&](const std::filesystem::path& path,
                         const std::vector<std::string>& sensors = {}) {
    const std::string message = input_error([&] { read_dataset(config_for(path), sensors); });
    EXPECT_THAT(message, testing::Not(HasSubstr("\n")));
    return message;
  };
  EXPECT_THAT(error(""), HasSubstr("dataset.path"));
  EXPECT_THAT(error(dir.path() / "nowhere"), HasSubstr("no such file or folder"));
  EXPECT_THAT(error(dir.path()), HasSubstr("no data set"));
  EXPECT_THAT(error(dir.write("notes.txt", "x")), HasSubstr("not a data set"));
  std::filesystem::create_directories(dir.path() / "mav0");
  EXPECT_THAT(error(dir.path()), HasSubstr("none of the requested sensors"));
  std::filesystem::create_directories(dir.path() / "mav0/imu0");
  EXPECT_THAT(error(dir.path()), HasSubstr("imu0/data.csv: missing"));
  test::write_imu(dir, "");
  EXPECT_THAT(error(dir.path()), HasSubstr("the file is empty"));
  test::write_imu(dir, "\n\n");
  EXPECT_THAT(error(dir.path()), HasSubstr("the file is empty"));
  test::write_imu(dir, imu_rows({1.0}));
  EXPECT_THAT(error(dir.path()), HasSubstr("data.csv:1: expected a header"));
  test::write_imu(dir, "#timestamp [ns],w_x,w_y,a_x,a_y,a_z\n");
  EXPECT_THAT(error(dir.path()), HasSubstr("no column \"w_z\""));
  test::write_imu(dir, "#timestamp [days],w_x,w_y,w_z,a_x,a_y,a_z\n");
  EXPECT_THAT(error(dir.path()), HasSubstr("[days]; known: [s], [ms], [us], [ns]"));
  test::write_imu(dir, kImuHeader);
  EXPECT_THAT(error(dir.path(), {"sonar"}), HasSubstr("no sensor \"sonar\""));
  EXPECT_THAT(error(dir.path() / "mav0"), HasSubstr("contains mav0"));
  dir.write("rig.yaml", "dvl0: {}\n");
  EXPECT_THAT(error(dir.path()), HasSubstr("dvl0/data.csv: missing"));
  EXPECT_EQ(error(dir.path(), {"imu"}), "");
}

TEST(DatasetFolder, FolderOfABagIsAnErrorThatNamesTheBag) {
  const TmpDir dir;
  dir.write("dive.BAG", "");
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.path())); }),
              HasSubstr("specify the bag in this folder: " + (dir.path() / "dive.BAG").string()));
}

TEST(DatasetFolder, ReadsOwnOrConfiguredCalibration) {
  const TmpDir dir;
  test::write_imu(dir, kImuHeader);
  auto config = config_for(dir.path());
  EXPECT_TRUE(io::open_sequence(config, {})->rig().is_null());
  dir.write("rig.yaml", "world: ned\n");
  EXPECT_EQ(io::open_sequence(config, {})->rig().find("world")->text, "ned");
  config.rig = dir.write("other.yaml", "world: up\n").string();
  EXPECT_EQ(io::open_sequence(config, {})->rig().find("world")->text, "up");
  config.rig = "missing.yaml";
  EXPECT_THAT(input_error([&] { io::open_sequence(config, {}); }), HasSubstr("missing.yaml"));
}

TEST(DatasetFolder, GnssMayBeLatitudeAndLongitude) {
  const TmpDir dir;
  dir.write("mav0/gnss0/data.csv",
            "#timestamp [ns],latitude [deg],longitude [deg],altitude [m]\n"
            "1,0,0,0\n2,59.4,10.5,3\n3,59.401,10.5,5\n");
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.dropped("gnss", DropReason::malformed), 1U);
  ASSERT_EQ(out.events.size(), 2U);
  EXPECT_NEAR(std::get<GnssSample>(out.events[1]).east_north_up.y(), 111.4, 0.1);
}

TEST(DatasetFolder, ReferenceIsGroundTruthElseGnss) {
  const TmpDir dir;
  test::write_imu(dir, kImuHeader);
  const auto reference = [&] { return io::open_sequence(config_for(dir.path()), {})->reference(); };
  EXPECT_FALSE(reference());
  dir.write("mav0/gnss0/data.csv", "#timestamp [ns],east [m],north [m],up [m]\n1,2,3,0\n2,2,4,0\n");
  ASSERT_TRUE(reference());
  EXPECT_FALSE(reference()->has_rotation);
  EXPECT_FALSE(reference()->has_height);
  EXPECT_DOUBLE_EQ(reference()->path_length(), 1.0);
  dir.write("mav0/state_groundtruth_estimate0/data.csv",
            "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n1,1,2,3,0,1,0,0\n");
  ASSERT_TRUE(reference());
  EXPECT_TRUE(reference()->has_rotation);
  EXPECT_EQ(reference()->size(), 1U);
}

}  // namespace
}  // namespace apvi
