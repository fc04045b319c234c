// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/cdr_bytes.hpp"
#include "io/dataset_builder.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag/ros_samples.hpp"
#include "io/rosbag2/ros2_definitions.hpp"

namespace apvi {
namespace {

using io::RosMessageType;
using io::RosWire;
using test::CdrBytes;
using test::input_error;
using test::kSeparator;

RosMessageType cdr_type(const std::string& name, const std::string& definition) {
  return {name, definition, RosWire::cdr};
}

RosMessageType standard_type(const std::string& name) {
  return cdr_type(name, io::ros2_definitions(name).at(0));
}

// Values whose alignment differs from their position without padding.
std::vector<std::uint8_t> mixed(bool big_endian) {
  CdrBytes bytes(big_endian);
  bytes.put(std::uint8_t{1}).put(2.5).put(std::int16_t{-3}).text("ab").put(std::uint64_t{1} << 40U);
  bytes.put(std::uint8_t{7}).put(std::int32_t{12}).put(std::uint32_t{34});
  bytes.put(std::uint32_t{2}).put(1.5).put(-1.5).put(std::uint32_t{0}).put(std::uint8_t{9});
  return bytes.put(std::uint32_t{1}).put(std::uint8_t{4}).put(0.25F).get();
}

TEST(Cdr, AlignsValuesInBothByteOrders) {
  const RosMessageType type = cdr_type(
      "test_msgs/msg/All",
      "uint8 A=3\nuint8 a 5\nfloat64 b\nint16 c -7\nstring<=10 s \"a b\"\nuint64 d\nuint8 e\n"
      "builtin_interfaces/Time t\nfloat64[<=3] some\nfloat64[] none\nuint8 f\n"
      "test_msgs/msg/Part[] parts\n" +
          kSeparator + "test_msgs/msg/Part\nuint8 x\nfloat32 y\n");
  for (const bool big_endian : {false, true}) {
    const auto bytes = mixed(big_endian);
    const auto value = type.decode(bytes);
    ASSERT_TRUE(value) << big_endian;
    EXPECT_EQ(value->number_at("b"), 2.5);
    EXPECT_EQ(value->number_at("c"), -3.0);
    EXPECT_EQ(value->find("s")->text(), "ab");
    EXPECT_EQ(value->number_at("d"), 1099511627776.0);
    EXPECT_EQ(value->find("t")->nanoseconds(), 12'000'000'034);
    EXPECT_EQ(value->find("some")->number(1), -1.5);
    EXPECT_FALSE(value->find("none")->number(0));
    EXPECT_EQ(value->number_at("f"), 9.0);
    EXPECT_EQ(value->find("parts")->items().at(0).number_at("y"), 0.25);
  }
}

TEST(Cdr, RejectsTruncatedMessagesAndOtherRepresentations) {
  const RosMessageType type = standard_type("sensor_msgs/Imu");
  auto bytes = test::cdr_imu(5, 0.1);
  ASSERT_TRUE(type.decode(bytes));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(type.decode(std::span(bytes).first(size))) << size;
  }
  bytes[1] = 3;  // a list of parameters
  EXPECT_FALSE(type.decode(bytes));
}

TEST(Cdr, PaddingAtTheEndIsNoError) {
  const RosMessageType type = cdr_type("a/B", "uint8 x\n");
  std::vector<std::uint8_t> bytes = {0, 1, 0, 0, 42};
  for (int padding = 0; padding < 4; ++padding, bytes.push_back(0)) {
    EXPECT_TRUE(type.decode(bytes)) << padding;
  }
  EXPECT_FALSE(type.decode(bytes));
}

TEST(Cdr, EmptyRecordHasOneByte) {
  const RosMessageType type = cdr_type("a/B", "C c\nuint8 x\n" + kSeparator + "a/C\n");
  const auto bytes = CdrBytes().put(std::uint8_t{0}).put(std::uint8_t{5}).get();
  EXPECT_EQ(type.decode(bytes)->number_at("x"), 5.0);
}

TEST(Cdr, DefaultValuesAreForRos2Only) {
  EXPECT_EQ(input_error([] { cdr_type("a/B", "int8 x 3\n"); }), "");
  EXPECT_NE(input_error([] { RosMessageType("a/B", "int8 x 3\n"); }), "");
}

TEST(Cdr, StandardDefinitionsDecodeTheirMessages) {
  const RosMessageType type = standard_type("sensor_msgs/Imu");
  const auto bytes = test::cdr_imu(7, 0.5, true);
  const auto imu = type.decode(bytes);
  ASSERT_TRUE(imu);
  EXPECT_EQ(io::stamp_of_message(*imu, {})->ns, 7);
  EXPECT_EQ(std::get<ImuSample>(*io::imu_of(*imu, {})).gyro.x(), 0.5);
  for (const char* name :
       {"sensor_msgs/Image", "sensor_msgs/CompressedImage", "sensor_msgs/FluidPressure",
        "sensor_msgs/NavSatFix", "geometry_msgs/TwistStamped",
        "geometry_msgs/TwistWithCovarianceStamped", "geometry_msgs/Vector3Stamped",
        "geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped",
        "geometry_msgs/TransformStamped", "nav_msgs/Odometry", "std_msgs/Float32",
        "std_msgs/Float64", "dvl_msgs/DVL", "waterlinked_a50_ros_driver/DVL",
        "uuv_sensor_ros_plugins_msgs/DVL", "stonefish_msgs/DVL"}) {
    EXPECT_EQ(input_error([&] { standard_type(name); }), "") << name;
  }
  EXPECT_TRUE(io::ros2_definitions("other_msgs/DVL").empty());
}

TEST(Cdr, BothLayoutsOfDvlMsgsAreKnown) {
  const auto definitions = io::ros2_definitions("dvl_msgs/DVL");
  ASSERT_EQ(definitions.size(), 2U);
  CdrBytes later;
  later.header(1).put(0.0).put(0.5).zeros(2).put(0.01).put(std::uint32_t{1}).put(0.04).put(2.5);
  later.put(std::uint32_t{0}).put(std::uint8_t{1}).put(std::int64_t{0}).put(std::int64_t{0});
  later.put(std::int64_t{0}).text("");
  EXPECT_FALSE(cdr_type("dvl_msgs/DVL", definitions[0]).decode(later.get()));
  EXPECT_TRUE(cdr_type("dvl_msgs/DVL", definitions[1]).decode(later.get()));
}

}  // namespace
}  // namespace apvi
