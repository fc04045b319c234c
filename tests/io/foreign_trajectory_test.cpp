// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/io/tum.hpp"
#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using test::input_error;
using test::TmpDir;
using testing::HasSubstr;

// Position (1, 2, 3), rotation by 90 degrees about z, at two stamps 0.05 s apart.
void expect_poses(const std::string& text) {
  const TmpDir dir;
  const Trajectory read = io::read_trajectory(dir.write("trajectory", text));
  ASSERT_EQ(read.size(), 2U) << text;
  EXPECT_EQ(read.poses[0].stamp.ns, 1'403'636'581'838'555'000) << text;
  EXPECT_EQ(read.poses[1].stamp.ns, 1'403'636'581'888'555'000) << text;
  const SE3& pose = read.poses[1].T_world_body;
  EXPECT_TRUE(pose.translation.isApprox(Eigen::Vector3d(1, 2, 3), 1e-12)) << text;
  EXPECT_NEAR(pose.rotation.z(), std::sqrt(0.5), 1e-4) << text;
  EXPECT_NEAR(pose.rotation.w(), std::sqrt(0.5), 1e-4) << text;
}

// The rows of both stamps: `before` the stamp, and `after` it.
std::string rows(const std::string& first, const std::string& second, const std::string& after,
                 const std::string& before = "") {
  return before + first + after + "\n" + before + second + after + "\n";
}

TEST(ForeignTrajectories, UnitsThatTheStampsContradictAreReplaced) {
  const std::string header = ",p_x,p_y,p_z,q_w,q_x,q_y,q_z\n";
  const std::string pose = ",1,2,3,0.7071,0,0,0.7071";
  expect_poses("#timestamp [ns]" + header + rows("1403636581838555", "1403636581888555", pose));
  expect_poses("#timestamp [s]" + header +
               rows("1403636581838555000", "1403636581888555000", pose));
  expect_poses("#timestamp [us]" + header + rows("1403636581.838555", "1403636581.888555", pose));
}

TEST(ForeignTrajectories, AreReadByTheNamesOfTheirHeaders) {
  const std::string a = "1403636581838555000";
  const std::string b = "1403636581888555000";
  const std::string s = "1403636581.838555";
  const std::string t = "1403636581.888555";
  expect_poses("timestamp qw qx qy qz tx ty tz\n" + rows(s, t, " 0.7071 0 0 0.7071 1 2 3"));
  expect_poses("# timestamp(s) tx ty tz qx qy qz qw Pr11\n" +
               rows(s, t, " 1 2 3 0 0 0.7071 0.7071 9"));
  expect_poses("timestamp, p_WS_W_x, p_WS_W_y, p_WS_W_z, q_WS_x, q_WS_y, q_WS_z, q_WS_w\n" +
               rows(a, b, ", 1, 2, 3, 0, 0, 0.7071, 0.7071"));
  expect_poses("# time_ns, x, y, z, qx, qy, qz, qw\n" +
               rows(a, b, ", 1, 2, 3, 0, 0, 0.7071, 0.7071"));
  expect_poses("num,t,x,y,z,qx,qy,qz,qw\n" + rows(s, t, ",1,2,3,0,0,0.7071,0.7071", "7,"));
  expect_poses(
      "#timestamp [ns],p_RS_R_x [mm],p_RS_R_y [cm],p_RS_R_z [m],q_RS_w [],q_RS_x [],"
      "q_RS_y [],q_RS_z []\n" +
      rows(a, b, ",1000,200,3,0.7071,0,0,0.7071"));
  expect_poses("#timestamp,x,y,z,qw,qx,qy,qz,vx,vy,vz\n" +
               rows(a, b, ",1,2,3,0.7071,0,0,0.7071,9,9,9"));
  expect_poses(
      "time;pose.position.x;pose.position.y;pose.position.z;pose.orientation.x;"
      "pose.orientation.y;pose.orientation.z;pose.orientation.w\n" +
      rows(a, b, ";1;2;3;0;0;0.7071;0.7071"));
}

TEST(ForeignTrajectories, NamesMayBeThoseOfTopics) {
  const std::string pose = "/odom/pose/pose/";
  std::string header = "__time";
  for (const char* axis : {"x", "y", "z"}) header += "," + pose + "position/" + axis;
  for (const char* axis : {"x", "y", "z", "w"}) header += "," + pose + "orientation/" + axis;
  expect_poses(header + "\n" +
               rows("1403636581.838555", "1403636581.888555", ",1,2,3,0,0,0.7071,0.7071"));
}

TEST(ForeignTrajectories, SpreadsheetsMayHaveDecimalCommasAndRowNumbers) {
  expect_poses("t;x;y;z;qx;qy;qz;qw\n" +
               rows("1403636581,838555", "1403636581,888555", ";1,0;2;3;0;0;0,7071;0,7071"));
  expect_poses(",time,x,y,z,qx,qy,qz,qw\n" +
               rows("1403636581.838555", "1403636581.888555", ",1,2,3,0,0,0.7071,0.7071", "0,"));
}

TEST(ForeignTrajectories, LatitudesBecomeMetersFromTheFirstFix) {
  const TmpDir dir;
  const Trajectory read = io::read_trajectory(
      dir.write("fixes.csv", "timestamp [s],lat,lon,alt\n1,59.4,10.5,3\n2,59.401,10.5,5\n"));
  ASSERT_EQ(read.size(), 2U);
  EXPECT_FALSE(read.has_rotation);
  EXPECT_EQ(read.poses[0].T_world_body.translation.norm(), 0.0);
  EXPECT_NEAR(read.poses[1].T_world_body.translation.y(), 111.4, 0.1);
  EXPECT_NEAR(read.poses[1].T_world_body.translation.z(), 2.0, 0.01);
  const auto raw = dir.write("raw.csv", "timestamp,lat,lon,alt\n1,594000000,105000000,3\n");
  EXPECT_THAT(input_error([&] { io::read_trajectory(raw); }),
              HasSubstr("raw.csv:2: latitude and longitude are no position in degrees"));
}

TEST(ForeignTrajectories, Utf16IsAnErrorThatSaysSo) {
  const TmpDir dir;
  const auto file = dir.write("utf16.txt", std::string("\xFF\xFE"
                                                       "1\0 \0",
                                                       6));
  EXPECT_THAT(input_error([&] { io::read_trajectory(file); }), HasSubstr("this file is UTF-16"));
}

TEST(ForeignTrajectories, UnitOfStampsIsToldByTheirSize) {
  const std::string tum = " 1 2 3 0 0 0.7071 0.7071";
  expect_poses(rows("1403636581838555000.000000", "1403636581888555000.000000", tum));
  expect_poses(rows("1.403636581838555e18", "1.403636581888555e18", tum));
  expect_poses(rows("1403636581838555", "1403636581888555", tum));
  expect_poses(rows("1403636581838.555", "1403636581888.555", tum));
  expect_poses(rows("1.403636581838555e+09", "1.403636581888555e+09", tum + " "));
  expect_poses(rows("1403636581838555000", "1403636581888555000", ",1,2,3,0.7071,0,0,0.7071,9,9,"));
}

// What the log says of rotations about one axis, by up to 90 degrees; `row` is the format of the
// cosine (0) and sine (1) of half the angle.
std::string log_of_turn(const std::string& row) {
  const TmpDir dir;
  std::string text;
  for (int i = 0; i <= 10; ++i) {
    const double half = 0.5 * i * 0.15707963;
    text += fmt::format(fmt::runtime(row), std::cos(half), std::sin(half), i) + "\n";
  }
  testing::internal::CaptureStderr();
  io::read_trajectory(dir.write("turn.txt", text));
  return testing::internal::GetCapturedStderr();
}

TEST(ForeignTrajectories, QuaternionsThatSeemToHaveTheOtherOrderAreAWarning) {
  EXPECT_THAT(log_of_turn("{2}.5 0 0 0 {0:.9f} 0 0 {1:.9f}"), HasSubstr("tx ty tz qw qx qy qz"));
  EXPECT_THAT(log_of_turn("{2},0,0,0,0,0,{1:.9f},{0:.9f}"), HasSubstr("tx,ty,tz,qx,qy,qz,qw"));
}

TEST(ForeignTrajectories, QuaternionsInTheOrderOfTheFormatAreNoWarning) {
  EXPECT_EQ(log_of_turn("{2}.5 0 0 0 0 0 {1:.9f} {0:.9f}"), "");  // yaw
  EXPECT_EQ(log_of_turn("{2}.5 0 0 0 {0:.9f} {1:.9f} 0 0"), "");  // yaw of a body with z down
  EXPECT_EQ(log_of_turn("{2}.5 0 0 0 0 {1:.9f} 0 {0:.9f}"), "");  // pitch
  EXPECT_EQ(log_of_turn("{2},0,0,0,{1:.9f},0,0,{0:.9f}"), "");    // yaw that begins backward
  EXPECT_EQ(log_of_turn("{2},0,0,0,{0:.9f},{1:.9f},0,0"), "");    // roll
  EXPECT_EQ(log_of_turn("# t x y z qw qx qy qz\n{2}.5 0 0 0 {0:.9f} 0 0 {1:.9f}"), "");
}

TEST(ForeignTrajectories, StampsWithoutTheirDigitsAreAnError) {
  const TmpDir dir;
  std::string text;
  for (int i = 0; i < 60; ++i) text += fmt::format("{} {} 0 0 0 0 0 1\n", 1403636581 + i / 20, i);
  EXPECT_THAT(input_error([&] { io::read_trajectory(dir.write("t", text)); }),
              HasSubstr("such as 1403636583: the stamps lost digits"));
  EXPECT_THAT(input_error([&] {
                io::read_trajectory(dir.write("t", "18446744073709551615 1 2 3 0 0 0 1\n"));
              }),
              HasSubstr("\"18446744073709551615\" is not a time"));
}

TEST(ForeignTrajectories, MatricesWithoutStampsAreAnError) {
  const TmpDir dir;
  EXPECT_THAT(
      input_error([&] { io::read_trajectory(dir.write("t", "1 0 0 1 0 1 0 2 0 0 1 3\n")); }),
      HasSubstr("matrices"));
}

TEST(Reference, BadRowsAreDroppedAndCountedInOneWarning) {
  const TmpDir dir;
  test::write_imu(dir, test::kImuHeader);
  dir.write("mav0/state_groundtruth_estimate0/data.csv",
            "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n1,1,2,3,1,0,0,0\n"
            "2,nan,nan,nan,nan,nan,nan,nan\n3,,,,,,,\n4,1,2,3,1,0,0,0\n4,1,2,3,1,0,0,0\n"
            "3,1,2,3,1,0,0,0\n5,1,2,3,0,0,0,0\nx\n6,1,2,3,1,0,0,0\n");
  testing::internal::CaptureStderr();
  const auto reference = io::open_sequence(test::config_for(dir.path()), {})->reference();
  const std::string log = testing::internal::GetCapturedStderr();
  ASSERT_TRUE(reference);
  EXPECT_EQ(reference->size(), 3U);
  EXPECT_THAT(log, HasSubstr("6 of 9 lines dropped; the first"));
  EXPECT_THAT(log, HasSubstr("data.csv:3: number is not finite"));
}

TEST(Reference, WithoutAnyGoodRowIsAnError) {
  const TmpDir dir;
  EXPECT_THAT(input_error([&] {
                io::read_trajectory(dir.write("t", "1 nan 0 0 0 0 0 1\n"), io::BadLines::drop);
              }),
              HasSubstr("t:1: number is not finite"));
}

}  // namespace
}  // namespace apvi
