// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/io/tum.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "apvi/core/error.hpp"
#include "core/random.hpp"
#include "io/dataset_builder.hpp"
#include "support/test_data.hpp"

namespace apvi {
namespace {

using test::input_error;
using test::TmpDir;
using testing::HasSubstr;

Trajectory random_trajectory(std::size_t count) {
  Random random(7);
  Trajectory trajectory;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector4d q(random.normal(), random.normal(), random.normal(), random.normal());
    trajectory.poses.push_back(
        {Stamp{1'403'636'580'838'555'574 + static_cast<std::int64_t>(i) * 49'999'999},
         SE3{Eigen::Quaterniond(q.normalized()),
             {random.normal(0, 100), random.normal(0, 100), random.normal()}}});
  }
  return trajectory;
}

void expect_same(const Trajectory& a, const Trajectory& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.poses[i].stamp, b.poses[i].stamp);
    EXPECT_LT((a.poses[i].T_world_body.matrix() - b.poses[i].T_world_body.matrix()).norm(), 1e-8);
  }
}

TEST(TrajectoryFiles, RoundTrip) {
  const TmpDir dir;
  const Trajectory trajectory = random_trajectory(50);
  io::write_tum(dir.path() / "a.tum", trajectory);
  expect_same(io::read_trajectory(dir.path() / "a.tum"), trajectory);
  io::write_euroc(dir.path() / "a.csv", trajectory);
  expect_same(io::read_trajectory(dir.path() / "a.csv"), trajectory);
}

TEST(TrajectoryFiles, SupportNegativeAndZeroStamps) {
  const TmpDir dir;
  Trajectory trajectory = random_trajectory(3);
  trajectory.poses[0].stamp.ns = -1'500'000'001;
  trajectory.poses[1].stamp.ns = -7;
  trajectory.poses[2].stamp.ns = 0;
  io::write_tum(dir.path() / "a.tum", trajectory);
  expect_same(io::read_trajectory(dir.path() / "a.tum"), trajectory);
}

TEST(TrajectoryFiles, FormatIsDetectedByContent) {
  const TmpDir dir;
  const auto read = [&](const std::string& text) {
    return io::read_trajectory(dir.write("trajectory", text));
  };
  const Trajectory tum = read("# t x y z q\n1.5 1 2 3 0 0 0 1\r\n1.6\t1 2 3  0 0 1 0\n");
  EXPECT_EQ(tum.poses[0].stamp.ns, 1'500'000'000);
  EXPECT_DOUBLE_EQ(tum.poses[1].T_world_body.rotation.z(), 1.0);
  const Trajectory published = read(
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
      "q_RS_z [], v_RS_R_x [m s^-1]\n1500000000,1,2,3,0,0,0,1,9\n");
  EXPECT_EQ(published.poses[0].stamp.ns, 1'500'000'000);
  EXPECT_DOUBLE_EQ(published.poses[0].T_world_body.rotation.z(), 1.0);
  const Trajectory bare = read("1500000000,1,2,3,0,0,0,1\n");
  EXPECT_DOUBLE_EQ(bare.poses[0].T_world_body.rotation.z(), 1.0);
  const Trajectory tank = read(
      "timestamp[ns],pos_x[m],pos_y[m],pos_z[m],orient_qx,orient_qy,orient_qz,orient_qw\n"
      "1500000000,1,2,3,0,0,1,0\n");
  EXPECT_DOUBLE_EQ(tank.poses[0].T_world_body.rotation.z(), 1.0);
  const Trajectory gnss = read("#timestamp [ns],east [m],north [m],up [m]\n1,2,3,4\n");
  EXPECT_FALSE(gnss.has_rotation);
  EXPECT_TRUE(gnss.has_height);
  EXPECT_EQ(gnss.poses[0].T_world_body.translation, Eigen::Vector3d(2, 3, 4));
}

TEST(TrajectoryFiles, ErrorsNameFileAndLine) {
  const TmpDir dir;
  const auto error = [&](const std::string& text) {
    return input_error([&] { io::read_trajectory(dir.write("t.tum", text)); });
  };
  const std::string good = "1 0 0 0 0 0 0 1\n";
  EXPECT_THAT(error(""), HasSubstr("empty"));
  EXPECT_THAT(error("# only a header\n"), HasSubstr("no poses"));
  EXPECT_THAT(error(good + "2 0 0 0 0 0 1\n"), HasSubstr("t.tum:2: expected 8 numbers, got 7"));
  EXPECT_THAT(error(good + "2 0 x 0 0 0 0 1\n"), HasSubstr("t.tum:2: \"x\" is not a number"));
  EXPECT_THAT(error(good + "2 0 nan 0 0 0 0 1\n"), HasSubstr("t.tum:2: number is not finite"));
  EXPECT_THAT(error(good + "2 0 0 0 0 0 0 2\n"), HasSubstr("t.tum:2: the quaternion has norm"));
  EXPECT_THAT(error(good + "2 0 0 0 0 0 0 0\n"), HasSubstr("has norm 0"));
  EXPECT_THAT(error(good + "1 0 0 0 0 0 0 1\n"), HasSubstr("t.tum:2: the time does not increase"));
  EXPECT_THAT(error("nan 0 0 0 0 0 0 1\n"), HasSubstr("not a time in seconds"));
  EXPECT_THAT(error("#timestamp,a,b,c,d\n"), HasSubstr("no position columns"));
  EXPECT_THAT(input_error([&] { io::read_trajectory(dir.path()); }), HasSubstr("a folder"));
  EXPECT_THAT(input_error([&] { io::read_trajectory(dir.path() / "no"); }),
              HasSubstr("no such file"));
}

TEST(TrajectoryFiles, ReadTheKittiReference) {
  APVI_NEEDS_DATA(folder, "evo_reference");
  const Trajectory trajectory = io::read_trajectory(folder / "KITTI_00_gt.tum");
  std::ifstream in(folder / "KITTI_00_gt.tum");
  std::size_t lines = 0;
  for (std::string line; std::getline(in, line);) lines += line.starts_with('#') ? 0 : 1;
  EXPECT_EQ(trajectory.size(), lines);
  EXPECT_NEAR(trajectory.path_length(), 3724.187, 0.01);  // as published for KITTI 00
}

TEST(TextFiles, WriteCompletelyOrThrow) {
  const TmpDir dir;
  io::write_text_file(dir.path() / "a.txt", "content");
  std::ostringstream read_back;
  read_back << std::ifstream(dir.path() / "a.txt").rdbuf();
  EXPECT_EQ(read_back.str(), "content");
  EXPECT_THROW(io::write_text_file(dir.path() / "no" / "a.txt", "content"), RunError);
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  EXPECT_THROW(io::write_text_file("/dev/full", "content"), RunError);
}

}  // namespace
}  // namespace apvi
