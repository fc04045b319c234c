// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/dvl_message.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "apvi/core/log.hpp"
#include "io/ros_bytes.hpp"

namespace apvi {
namespace {

using io::RosMessageType;
using test::kHeaderPart;
using test::kSeparator;
using test::kVectorPart;
using test::RosBytes;

TEST(DvlMessages, ReadsDvlForkWithFewerFields) {
  const RosMessageType fork("fork_msgs/DVL",
                            "Header header\ngeometry_msgs/Vector3 velocity\nbool velocity_valid\n" +
                                kHeaderPart + kVectorPart);
  RosBytes bytes;
  bytes.header(10, 20).put(0.1).put(0.2).put(0.3).put(std::uint8_t{0});
  const auto value = fork.decode(bytes.get());
  ASSERT_TRUE(value);
  const Stamp stamp = io::stamp_of_message(*value, {}).value();
  EXPECT_EQ(stamp.ns, 10'000'000'020);
  const auto sample = std::get<DvlSample>(io::dvl_of(*value, stamp).value());
  EXPECT_EQ(sample.velocity, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_FALSE(sample.valid || sample.figure_of_merit || sample.altitude || sample.beams[0]);
}

TEST(DvlMessages, UuvSimulatorCovarianceMarksInvalid) {
  const RosMessageType type(
      "uuv_sensor_ros_plugins_msgs/DVL",
      "Header header\ngeometry_msgs/Vector3 velocity\nfloat64[9] velocity_covariance\n"
      "float64 altitude\nuuv_sensor_ros_plugins_msgs/DVLBeam[] beams\n" +
          kHeaderPart + kVectorPart + kSeparator +
          "uuv_sensor_ros_plugins_msgs/DVLBeam\nfloat64 range\nfloat64 range_covariance\n"
          "float64 velocity\nfloat64 velocity_covariance\n");
  const auto sample = [&](double covariance) {
    RosBytes bytes;
    bytes.header(0, 0).put(0.1).put(0.2).put(0.3).put(covariance);
    for (int i = 0; i < 8; ++i) bytes.put(0.0);
    bytes.put(4.5).put(std::uint32_t{1}).put(5.0).put(0.0).put(0.25).put(-1.0);
    const auto value = type.decode(bytes.get());
    EXPECT_EQ(io::stamp_of_message(*value, Stamp{77})->ns, 77);  // without stamp: recording time
    return std::get<DvlSample>(io::dvl_of(*value, Stamp{1}).value());
  };
  EXPECT_FALSE(sample(-1.0).valid);
  const DvlSample good = sample(0.0001);
  EXPECT_TRUE(good.valid);
  EXPECT_DOUBLE_EQ(good.figure_of_merit.value(), 0.01);
  EXPECT_DOUBLE_EQ(good.altitude.value(), 4.5);
  EXPECT_DOUBLE_EQ(good.beams[0]->velocity, 0.25);
  EXPECT_DOUBLE_EQ(good.beams[0]->range.value(), 5.0);
  EXPECT_FALSE(good.beams[0]->valid);
}

TEST(DvlMessages, ReadsTwistAsDvl) {
  const RosMessageType type(
      "geometry_msgs/TwistWithCovarianceStamped",
      "Header header\nTwistWithCovariance twist\n" + kHeaderPart + kVectorPart + kSeparator +
          "geometry_msgs/TwistWithCovariance\nTwist twist\nfloat64[36] covariance\n" + kSeparator +
          "geometry_msgs/Twist\nVector3 linear\nVector3 angular\n");
  RosBytes bytes;
  bytes.header(1, 0).put(1.0).put(2.0).put(3.0).put(0.0).put(0.0).put(0.0).put(0.04);
  for (int i = 0; i < 35; ++i) bytes.put(0.0);
  const auto sample =
      std::get<DvlSample>(io::dvl_of(type.decode(bytes.get()).value(), Stamp{1}).value());
  EXPECT_EQ(sample.velocity, Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(sample.valid);
  EXPECT_DOUBLE_EQ(sample.figure_of_merit.value(), 0.2);
}

// marine_acoustic_msgs/Dvl, and ds_sensor_msgs/Dvl with its coordinate mode.
struct Report {
  std::uint8_t mode = 1;
  std::uint8_t coordinates = 1;
  std::uint8_t good_beams = 4;
  std::uint8_t velocities_valid = 1;
  double variance = 0.0001;
};

DvlSample sample_of(const Report& report) {
  const RosMessageType type(
      "ds_sensor_msgs/Dvl",
      "uint8 DVL_MODE_BOTTOM=1\nstd_msgs/Header header\nuint8 velocity_mode\n"
      "uint8 coordinate_mode\ngeometry_msgs/Vector3 velocity\nfloat64[2] velocity_covar\n"
      "float64 altitude\nuint8 num_good_beams\nbool beam_velocities_valid\n" +
          kHeaderPart + kVectorPart);
  RosBytes bytes;
  bytes.header(1, 0).put(report.mode).put(report.coordinates).put(0.1).put(0.2).put(0.3);
  bytes.put(report.variance).put(0.0).put(2.5).put(report.good_beams).put(report.velocities_valid);
  return std::get<DvlSample>(io::dvl_of(type.decode(bytes.get()).value(), Stamp{1}).value());
}

TEST(DvlMessages, BottomTrackInInstrumentCoordinatesIsValid) {
  const DvlSample sample = sample_of({});
  EXPECT_TRUE(sample.valid);
  EXPECT_EQ(sample.velocity, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_DOUBLE_EQ(sample.figure_of_merit.value(), 0.01);
  EXPECT_DOUBLE_EQ(sample.altitude.value(), 2.5);
}

TEST(DvlMessages, UnknownVarianceIsNoReasonToReject) {
  const DvlSample sample = sample_of({.variance = -1.0});
  EXPECT_TRUE(sample.valid);
  EXPECT_FALSE(sample.figure_of_merit);
}

TEST(DvlMessages, WaterTrackIsInvalid) {
  EXPECT_FALSE(sample_of({.mode = 2}).valid);
}

TEST(DvlMessages, HeldVelocityOfInvalidBeamsIsInvalid) {
  EXPECT_FALSE(sample_of({.velocities_valid = 0}).valid);
  EXPECT_FALSE(sample_of({.good_beams = 2}).valid);
  EXPECT_TRUE(sample_of({.good_beams = 3}).valid);
}

TEST(DvlMessages, OtherCoordinatesThanTheInstrumentsAreInvalid) {
  for (const std::uint8_t coordinates : std::vector<std::uint8_t>{0, 2, 3}) {
    EXPECT_FALSE(sample_of({.coordinates = coordinates}).valid) << int{coordinates};
  }
}

TEST(DvlMessages, TwistInAWorldFrameIsInvalid) {
  const RosMessageType type("geometry_msgs/TwistStamped",
                            "Header header\nTwist twist\n" + kHeaderPart + kVectorPart +
                                kSeparator + "geometry_msgs/Twist\nVector3 linear\n");
  const auto valid_in = [&](const std::string& frame) {
    RosBytes bytes;
    bytes.put(std::uint32_t{7}).put(std::uint32_t{1}).put(std::uint32_t{0}).text(frame);
    bytes.put(0.1).put(0.2).put(0.3);
    const auto message = type.decode(bytes.get()).value();
    return std::get<DvlSample>(io::dvl_of(message, Stamp{1}).value()).valid;
  };
  EXPECT_TRUE(valid_in("dvl_link"));
  EXPECT_TRUE(valid_in("vehicle/base_link"));
  EXPECT_FALSE(valid_in("odom"));
  EXPECT_FALSE(valid_in("vehicle/ned"));
}

TEST(DvlMessages, TwistOfOdometryIsInItsChildFrame) {
  const RosMessageType type(
      "nav_msgs/Odometry",
      "Header header\nstring child_frame_id\ngeometry_msgs/TwistWithCovariance twist\n" +
          kHeaderPart + kVectorPart + kSeparator +
          "geometry_msgs/TwistWithCovariance\nTwist twist\n" + kSeparator +
          "geometry_msgs/Twist\nVector3 linear\n");
  RosBytes bytes;
  bytes.put(std::uint32_t{7}).put(std::uint32_t{1}).put(std::uint32_t{0}).text("odom");
  bytes.text("base_link").put(0.1).put(0.2).put(0.3);
  const auto message = type.decode(bytes.get()).value();
  EXPECT_TRUE(std::get<DvlSample>(io::dvl_of(message, Stamp{1}).value()).valid);
}

TEST(DvlMessages, NucleusIsValidWhenAllAxesAre) {
  const RosMessageType type(
      "interfaces/BottomTrack",
      "time system_timestamp\nbool x_velocity_valid\nbool y_velocity_valid\n"
      "bool z_velocity_valid\nfloat32 velocity_x\nfloat32 velocity_y\nfloat32 velocity_z\n"
      "float32 fom_x\nfloat32 fom_y\nfloat32 fom_z\n");
  const auto sample = [&](std::uint8_t z_valid) {
    RosBytes bytes;
    bytes.put(std::uint32_t{5}).put(std::uint32_t{6}).put(std::uint8_t{1}).put(std::uint8_t{1});
    bytes.put(z_valid).put(0.5F).put(0.25F).put(-1.0F).put(0.125F).put(0.25F).put(0.0625F);
    const auto message = type.decode(bytes.get()).value();
    EXPECT_EQ(io::stamp_of_message(message, {})->ns, 5'000'000'006);
    return std::get<DvlSample>(io::dvl_of(message, Stamp{1}).value());
  };
  EXPECT_TRUE(sample(1).valid);
  EXPECT_EQ(sample(1).velocity, Eigen::Vector3d(0.5, 0.25, -1.0));
  EXPECT_DOUBLE_EQ(sample(1).figure_of_merit.value(), 0.25);
  EXPECT_FALSE(sample(0).valid);
}

}  // namespace
}  // namespace apvi
