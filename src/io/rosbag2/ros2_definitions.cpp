// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/ros2_definitions.hpp"

#include <map>
#include <set>
#include <utility>

namespace apvi::io {
namespace {

struct Layout {
  std::string text;
  std::vector<std::string_view> nested;
};

const std::string kHeader = "std_msgs/Header header\n";
const std::string kWaterLinkedTail = "bool velocity_valid\nint64 status\n";

std::string beams_of(std::string_view package) {
  return std::string(package) + "/DVLBeam[] beams\n";
}

// Water Linked, as in the driver for ROS 1 and the first version of dvl_msgs.
Layout waterlinked_dvl(std::string_view package, std::string_view beam) {
  return {kHeader +
              "float64 time\ngeometry_msgs/Vector3 velocity\nfloat64 fom\nfloat64 altitude\n" +
              beams_of(package) + kWaterLinkedTail + "string form\n",
          {"std_msgs/Header", "geometry_msgs/Vector3", beam}};
}

// Later versions of dvl_msgs.
Layout dvl_msgs_dvl() {
  return {kHeader +
              "float64 time\ngeometry_msgs/Vector3 velocity\nfloat64 fom\nfloat64[] covariance\n"
              "float64 altitude\n" +
              beams_of("dvl_msgs") + kWaterLinkedTail +
              "int64 time_of_validity\nint64 time_of_transmission\nstring form\n",
          {"std_msgs/Header", "geometry_msgs/Vector3", "dvl_msgs/DVLBeam"}};
}

// UUV Simulator and Stonefish.
Layout simulator_dvl(std::string_view package, std::string_view beam) {
  return {kHeader +
              "geometry_msgs/Vector3 velocity\nfloat64[9] velocity_covariance\n"
              "float64 altitude\n" +
              beams_of(package),
          {"std_msgs/Header", "geometry_msgs/Vector3", beam}};
}

// marine_acoustic_msgs, as the drivers of Water Linked, Nortek and Teledyne publish it.
Layout marine_acoustic_dvl() {
  return {kHeader +
              "uint8 velocity_mode\nuint8 dvl_type\ngeometry_msgs/Vector3 velocity\n"
              "float64[9] velocity_covar\nfloat64 altitude\nfloat64 course_gnd\n"
              "float64 speed_gnd\nuint8 num_good_beams\nfloat32 sound_speed\n"
              "bool beam_ranges_valid\nbool beam_velocities_valid\n"
              "geometry_msgs/Vector3[4] beam_unit_vec\nfloat64[4] range\nfloat32[4] range_covar\n"
              "float32[4] beam_quality\nfloat32[4] beam_velocity\nfloat32[4] beam_velocity_covar\n",
          {"std_msgs/Header", "geometry_msgs/Vector3"}};
}

Layout stamped(const std::string& fields, std::vector<std::string_view> nested) {
  nested.insert(nested.begin(), "std_msgs/Header");
  return {kHeader + fields, std::move(nested)};
}

const Layout kWaterLinkedBeam = {
    "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool valid\n", {}};
const Layout kSimulatorBeam = {
    "float64 range\nfloat64 range_covariance\nfloat64 velocity\nfloat64 velocity_covariance\n"
    "geometry_msgs/PoseStamped pose\n",
    {"geometry_msgs/PoseStamped"}};

using Layouts = std::multimap<std::string, Layout, std::less<>>;

Layouts geometry_layouts() {
  return {
      {"std_msgs/Header", {"builtin_interfaces/Time stamp\nstring frame_id\n", {}}},
      {"geometry_msgs/Vector3", {"float64 x\nfloat64 y\nfloat64 z\n", {}}},
      {"geometry_msgs/Point", {"float64 x\nfloat64 y\nfloat64 z\n", {}}},
      {"geometry_msgs/Quaternion", {"float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n", {}}},
      {"geometry_msgs/Pose",
       {"Point position\nQuaternion orientation\n",
        {"geometry_msgs/Point", "geometry_msgs/Quaternion"}}},
      {"geometry_msgs/Transform",
       {"Vector3 translation\nQuaternion rotation\n",
        {"geometry_msgs/Vector3", "geometry_msgs/Quaternion"}}},
      {"geometry_msgs/Twist", {"Vector3 linear\nVector3 angular\n", {"geometry_msgs/Vector3"}}},
      {"geometry_msgs/PoseWithCovariance",
       {"Pose pose\nfloat64[36] covariance\n", {"geometry_msgs/Pose"}}},
      {"geometry_msgs/TwistWithCovariance",
       {"Twist twist\nfloat64[36] covariance\n", {"geometry_msgs/Twist"}}},
      {"geometry_msgs/PoseStamped", stamped("Pose pose\n", {"geometry_msgs/Pose"})},
      {"geometry_msgs/PoseWithCovarianceStamped",
       stamped("PoseWithCovariance pose\n", {"geometry_msgs/PoseWithCovariance"})},
      {"geometry_msgs/TransformStamped",
       stamped("string child_frame_id\nTransform transform\n", {"geometry_msgs/Transform"})},
      {"geometry_msgs/TwistStamped", stamped("Twist twist\n", {"geometry_msgs/Twist"})},
      {"geometry_msgs/TwistWithCovarianceStamped",
       stamped("TwistWithCovariance twist\n", {"geometry_msgs/TwistWithCovariance"})},
      {"geometry_msgs/Vector3Stamped", stamped("Vector3 vector\n", {"geometry_msgs/Vector3"})},
      {"nav_msgs/Odometry",
       stamped("string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
               "geometry_msgs/TwistWithCovariance twist\n",
               {"geometry_msgs/PoseWithCovariance", "geometry_msgs/TwistWithCovariance"})},
  };
}

Layouts sensor_layouts() {
  return {
      {"std_msgs/Float32", {"float32 data\n", {}}},
      {"std_msgs/Float64", {"float64 data\n", {}}},
      {"sensor_msgs/Imu",
       stamped("geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
               "geometry_msgs/Vector3 angular_velocity\n"
               "float64[9] angular_velocity_covariance\n"
               "geometry_msgs/Vector3 linear_acceleration\n"
               "float64[9] linear_acceleration_covariance\n",
               {"geometry_msgs/Quaternion", "geometry_msgs/Vector3"})},
      {"sensor_msgs/FluidPressure", stamped("float64 fluid_pressure\nfloat64 variance\n", {})},
      {"sensor_msgs/Image",
       stamped("uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
               "uint8[] data\n",
               {})},
      {"sensor_msgs/CompressedImage", stamped("string format\nuint8[] data\n", {})},
      {"sensor_msgs/NavSatStatus", {"int8 status\nuint16 service\n", {}}},
      {"sensor_msgs/NavSatFix",
       stamped("NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
               "float64[9] position_covariance\nuint8 position_covariance_type\n",
               {"sensor_msgs/NavSatStatus"})},
      {"marine_acoustic_msgs/Dvl", marine_acoustic_dvl()},
      {"dvl_msgs/DVLBeam", kWaterLinkedBeam},
      {"dvl_msgs/DVL", waterlinked_dvl("dvl_msgs", "dvl_msgs/DVLBeam")},
      {"dvl_msgs/DVL", dvl_msgs_dvl()},
      {"waterlinked_a50_ros_driver/DVLBeam", kWaterLinkedBeam},
      {"waterlinked_a50_ros_driver/DVL",
       waterlinked_dvl("waterlinked_a50_ros_driver", "waterlinked_a50_ros_driver/DVLBeam")},
      {"uuv_sensor_ros_plugins_msgs/DVLBeam", kSimulatorBeam},
      {"uuv_sensor_ros_plugins_msgs/DVL",
       simulator_dvl("uuv_sensor_ros_plugins_msgs", "uuv_sensor_ros_plugins_msgs/DVLBeam")},
      {"stonefish_msgs/DVLBeam", kSimulatorBeam},
      {"stonefish_msgs/DVL", simulator_dvl("stonefish_msgs", "stonefish_msgs/DVLBeam")},
  };
}

const Layouts& all_layouts() {
  static const Layouts layouts = [] {
    Layouts all = geometry_layouts();
    all.merge(sensor_layouts());
    return all;
  }();
  return layouts;
}

// Nested types have one layout.
void append_nested(const Layout& layout, std::set<std::string_view>& done, std::string& text) {
  for (const std::string_view name : layout.nested) {
    if (!done.insert(name).second) continue;
    const Layout& nested = all_layouts().find(name)->second;
    text.append(ros2_section(name, nested.text));
    append_nested(nested, done, text);
  }
}

}  // namespace

std::string ros2_section(std::string_view type, std::string_view text) {
  std::string section = "\n";
  return section.append(80, '=').append("\nMSG: ").append(type).append("\n").append(text);
}

std::string ros2_sections() {
  std::string sections;
  for (const auto& [type, layout] : all_layouts()) sections.append(ros2_section(type, layout.text));
  return sections;
}

std::vector<std::string> ros2_definitions(std::string_view type) {
  std::vector<std::string> definitions;
  const auto [begin, end] = all_layouts().equal_range(type);
  for (auto it = begin; it != end; ++it) {
    std::string text = it->second.text;
    std::set<std::string_view> done;
    append_nested(it->second, done, text);
    definitions.push_back(std::move(text));
  }
  return definitions;
}

}  // namespace apvi::io
