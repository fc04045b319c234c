// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/navsat.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "io/ros_bytes.hpp"

namespace apvi {
namespace {

using io::RosMessageType;
using test::RosBytes;

std::optional<io::GeodeticPosition> fix(std::int8_t status, double latitude, double longitude) {
  const RosMessageType type("sensor_msgs/NavSatFix",
                            "NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
                            "float64 altitude\n" +
                                test::kSeparator + "sensor_msgs/NavSatStatus\nint8 status\n");
  RosBytes bytes;
  bytes.put(status).put(latitude).put(longitude).put(12.5);
  return io::fix_of(type.decode(bytes.get()).value());
}

TEST(NavSat, RowsWithoutAFixAreDropped) {
  EXPECT_TRUE(fix(0, 59.4, 10.5));
  EXPECT_EQ(fix(2, 59.4, 10.5)->altitude_m, 12.5);
  EXPECT_FALSE(fix(-1, 59.4, 10.5));
  EXPECT_FALSE(fix(0, std::nan(""), 10.5));
  EXPECT_FALSE(fix(0, 0.0, 0.0));
  EXPECT_FALSE(fix(0, 91.0, 10.5));
}

// Lengths of a degree at 45 degrees of latitude on WGS84: 111 131.75 m and 78 846.81 m.
TEST(NavSat, DegreesHaveTheLengthsOfTheEllipsoid) {
  const io::GeodeticPosition origin{45.0, 7.0, 100.0};
  const double scale = 1.0 + 100.0 / 6378137.0;  // of arcs 100 m above it
  const Eigen::Vector3d north = io::east_north_up({45.001, 7.0, 100.0}, origin);
  EXPECT_NEAR(north.y(), 111.13175 * scale, 2e-3);
  EXPECT_NEAR(north.x(), 0.0, 1e-6);
  const Eigen::Vector3d east = io::east_north_up({45.0, 7.001, 100.0}, origin);
  EXPECT_NEAR(east.x(), 78.84681 * scale, 2e-3);
  EXPECT_NEAR(east.y(), 0.0, 1e-3);
  EXPECT_NEAR(io::east_north_up({45.0, 7.0, 103.0}, origin).z(), 3.0, 1e-6);
}

TEST(NavSat, UnknownAltitudeIsThatOfTheOrigin) {
  const io::GeodeticPosition origin{45.0, 7.0, 100.0};
  EXPECT_NEAR(io::east_north_up({45.0, 7.0, std::nan("")}, origin).z(), 0.0, 1e-6);
}

}  // namespace
}  // namespace apvi
