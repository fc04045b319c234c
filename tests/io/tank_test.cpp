// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using test::config_for;
using test::input_error;
using test::TmpDir;
using testing::HasSubstr;

// Headers as written by the data set's own tool.
void write_raw(const TmpDir& dir) {
  dir.write("imu.csv",
            "timestamp[ns],ang_vel_x[rad/s],ang_vel_y[rad/s],ang_vel_z[rad/s],lin_acc_x[m/s^2],"
            "lin_acc_y[m/s^2],lin_acc_z[m/s^2]\r\n1000,1,2,3,4,5,6\r\n4000,1,2,3,4,5,6\r\n");
  dir.write("dvl.csv",
            "timestamp[ns],vel_x[m/s],vel_y[m/s],vel_z[m/s],beam1_vel[m/s],beam2_vel[m/s],"
            "beam3_vel[m/s],beam4_vel[m/s]\r\n2000,0.1,0.2,0.3,1,2,3,4\r\n"
            "3000,0.0,0.0,0.0,0.0,0.0,0.0,0.0\r\n");
  dir.write("depth.csv", "timestamp[ns],pos_z[m]\r\n2500,-1.5\r\n");
  dir.write("gt.csv",
            "timestamp[ns],pos_x[m],pos_y[m],pos_z[m],orient_qx,orient_qy,orient_qz,orient_qw\r\n"
            "2000,1,2,3,0,0,0,1\r\n");
  std::filesystem::create_directories(dir.path() / "IMG_L");
  cv::imwrite((dir.path() / "IMG_L/10500.png").string(), cv::Mat(4, 6, CV_8UC3, {1, 2, 3}));
  dir.write("IMG_L/2600.png", "damaged");
  dir.write("IMG_L/thumbnail.png", "no stamp");
  dir.write("IMG_L/notes.txt", "no image");
}

TEST(TankFolder, IsDetectedAndReadChronologically) {
  const TmpDir dir;
  write_raw(dir);
  const auto out = test::read_dataset(config_for(dir.path()));
  std::vector<std::string> kinds;
  for (const auto& event : out.events) kinds.emplace_back(kind_of(event));
  EXPECT_THAT(kinds, testing::ElementsAre("imu", "dvl", "depth", "camera", "dvl", "imu", "camera"));
  EXPECT_EQ(out.dropped("camera", io::DropReason::malformed), 1U);
  EXPECT_EQ(std::get<ImageFrame>(out.events.back()).decode().type(), CV_8UC3);
}

TEST(TankFolder, ConvertsHeightToDepthAndZerosToInvalidVelocity) {
  const TmpDir dir;
  write_raw(dir);
  const auto out = test::read_dataset(config_for(dir.path()), {"dvl", "pressure"});
  ASSERT_EQ(out.events.size(), 3U);
  const auto& dvl = std::get<DvlSample>(out.events[0]);
  EXPECT_TRUE(dvl.valid);
  EXPECT_EQ(dvl.velocity, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_DOUBLE_EQ(dvl.beams[0]->velocity, 1.0);
  EXPECT_DOUBLE_EQ(dvl.beams[3]->velocity, 4.0);
  EXPECT_FALSE(dvl.figure_of_merit || dvl.altitude);
  EXPECT_DOUBLE_EQ(std::get<PressureDepthSample>(out.events[1]).depth_m, 1.5);
  EXPECT_FALSE(std::get<DvlSample>(out.events[2]).valid);
}

TEST(TankFolder, ReadsGroundTruth) {
  const TmpDir dir;
  write_raw(dir);
  const auto reference = io::open_sequence(config_for(dir.path()), {})->reference();
  ASSERT_TRUE(reference);
  EXPECT_EQ(reference->poses[0].T_world_body.translation, Eigen::Vector3d(1, 2, 3));
}

TEST(TankFolder, RejectsMissingSensorOfRig) {
  const TmpDir dir;
  write_raw(dir);
  std::filesystem::remove(dir.path() / "dvl.csv");
  const auto open = [&] { io::open_sequence(config_for(dir.path()), {}); };
  EXPECT_EQ(input_error(open), "");
  dir.write("rig.yaml", "imu0: {}\ndvl0: {}\n");
  EXPECT_THAT(input_error(open), HasSubstr("dvl.csv: missing"));
}

}  // namespace
}  // namespace apvi
