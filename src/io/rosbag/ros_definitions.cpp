// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/ros_definitions.hpp"

#include <string_view>
#include <utility>
#include <vector>

namespace apvi::io {
namespace {

// These layouts must match the published messages: the checksums cover field types and names.
constexpr const char* kHeader = "uint32 seq\ntime stamp\nstring frame_id\n";
constexpr const char* kVector3 = "float64 x\nfloat64 y\nfloat64 z\n";
constexpr const char* kPoint = "float64 x\nfloat64 y\nfloat64 z\n";
constexpr const char* kQuaternion = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";
constexpr const char* kPose = "Point position\nQuaternion orientation\n";
constexpr const char* kPoseWithCovariance = "Pose pose\nfloat64[36] covariance\n";
constexpr const char* kTwist = "Vector3 linear\nVector3 angular\n";
constexpr const char* kTwistWithCovariance = "Twist twist\nfloat64[36] covariance\n";

using Part = std::pair<std::string_view, std::string_view>;  // type, text

RosDefinition define(std::string type, std::string md5, std::string text,
                     const std::vector<Part>& parts) {
  for (const auto& [name, part] : parts) {
    text.append("\n").append(80, '=').append("\nMSG: ").append(name).append("\n").append(part);
  }
  return {std::move(type), std::move(md5), std::move(text)};
}

}  // namespace

const RosDefinition& imu_definition() {
  static const RosDefinition definition =
      define("sensor_msgs/Imu", "6a62c6daae103f4ff57a132d6f95cec2",
             "Header header\n"
             "geometry_msgs/Quaternion orientation\n"
             "float64[9] orientation_covariance\n"
             "geometry_msgs/Vector3 angular_velocity\n"
             "float64[9] angular_velocity_covariance\n"
             "geometry_msgs/Vector3 linear_acceleration\n"
             "float64[9] linear_acceleration_covariance\n",
             {{"std_msgs/Header", kHeader},
              {"geometry_msgs/Quaternion", kQuaternion},
              {"geometry_msgs/Vector3", kVector3}});
  return definition;
}

const RosDefinition& fluid_pressure_definition() {
  static const RosDefinition definition = define(
      "sensor_msgs/FluidPressure", "804dc5cea1c5306d6a2eb80b9833befe",
      "Header header\nfloat64 fluid_pressure\nfloat64 variance\n", {{"std_msgs/Header", kHeader}});
  return definition;
}

const RosDefinition& odometry_definition() {
  static const RosDefinition definition =
      define("nav_msgs/Odometry", "cd5e73d190d741a2f92e81eda573aca7",
             "Header header\n"
             "string child_frame_id\n"
             "geometry_msgs/PoseWithCovariance pose\n"
             "geometry_msgs/TwistWithCovariance twist\n",
             {{"std_msgs/Header", kHeader},
              {"geometry_msgs/PoseWithCovariance", kPoseWithCovariance},
              {"geometry_msgs/Pose", kPose},
              {"geometry_msgs/Point", kPoint},
              {"geometry_msgs/Quaternion", kQuaternion},
              {"geometry_msgs/TwistWithCovariance", kTwistWithCovariance},
              {"geometry_msgs/Twist", kTwist},
              {"geometry_msgs/Vector3", kVector3}});
  return definition;
}

const RosDefinition& compressed_image_definition() {
  static const RosDefinition definition =
      define("sensor_msgs/CompressedImage", "8f7a12909da2c9d3332d540a0977563f",
             "Header header\nstring format\nuint8[] data\n", {{"std_msgs/Header", kHeader}});
  return definition;
}

const RosDefinition& waterlinked_dvl_definition() {
  static const RosDefinition definition =
      define("waterlinked_a50_ros_driver/DVL", "dea1debc1aca7804a62c507714ec3777",
             "Header header\n"
             "float64 time\n"
             "geometry_msgs/Vector3 velocity\n"
             "float64 fom\n"
             "float64 altitude\n"
             "waterlinked_a50_ros_driver/DVLBeam[] beams\n"
             "bool velocity_valid\n"
             "int64 status\n"
             "string form\n",
             {{"std_msgs/Header", kHeader},
              {"geometry_msgs/Vector3", kVector3},
              {"waterlinked_a50_ros_driver/DVLBeam",
               "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\n"
               "bool valid\n"}});
  return definition;
}

}  // namespace apvi::io
