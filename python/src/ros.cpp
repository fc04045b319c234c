// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>

#include <map>

#include "apvi/core/error.hpp"
#include "bindings.hpp"
#include "io/folder/pressure_unit.hpp"
#include "io/rosbag/dvl_message.hpp"
#include "io/rosbag/ros_samples.hpp"
#include "io/rosbag2/ros2_definitions.hpp"

namespace apvi::python {
namespace {

io::MessageToEvent converter_of(const std::string& sensor) {
  if (sensor == "imu") return io::imu_with({});
  if (sensor == "dvl") return io::dvl_converter(sensor);
  if (sensor == "pressure") return io::pressure_of({});
  if (sensor == "depth") return io::depth_of;
  if (sensor == "cam0" || sensor == "cam1") return io::image_of(sensor == "cam0" ? 0 : 1, sensor);
  fail_input("{}: not imu, dvl, pressure, depth, cam0 or cam1", sensor);
}

std::vector<std::string> definitions_of(const std::string& type, const std::string& given) {
  if (!given.empty()) return {given};
  std::vector<std::string> known = io::ros2_definitions(io::ros_type_name(type));
  if (known.empty()) fail_input("{}: give its definition; no sensor is known to use it", type);
  return known;
}

/// Makes samples of serialized ROS 2 messages, as the reader of bags does.
class RosDecoder {
 public:
  RosDecoder(const std::string& sensor, const std::string& type, const std::string& definition)
      : convert_(converter_of(sensor)) {
    for (const std::string& text : definitions_of(type, definition)) {
      types_.emplace_back(io::ros_type_name(type), text, io::RosWire::cdr);
    }
  }

  std::optional<SensorEvent> decode(const py::bytes& message, std::int64_t received) const {
    const auto text = static_cast<std::string_view>(message);
    const std::span bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
    const py::gil_scoped_release unlocked;
    for (const io::RosMessageType& type : types_) {
      const auto value = type.decode(bytes);
      if (!value) continue;
      const auto stamp = io::stamp_of_message(*value, Stamp{received});
      return stamp ? convert_(*value, *stamp) : std::nullopt;
    }
    return std::nullopt;
  }

 private:
  io::MessageToEvent convert_;
  std::vector<io::RosMessageType> types_;
};

}  // namespace

void bind_ros(py::module_& m) {
  py::class_<RosDecoder>(m, "RosDecoder",
                         "Makes samples of serialized ROS 2 messages; needs no ROS.")
      .def(py::init<const std::string&, const std::string&, const std::string&>(),
           py::arg("sensor"), py::arg("type"), py::arg("definition") = "",
           "sensor: imu, dvl, pressure, depth, cam0 or cam1. type: such as sensor_msgs/msg/Imu.\n"
           "definition: as a bag stores it; empty for the types that docs/formats.md lists.")
      .def(
          "decode", &RosDecoder::decode, py::arg("message"), py::arg("received") = 0,
          "The sample of a message in CDR, or None if it is malformed. Its stamp is the header's,\n"
          "else `received` [ns].");
}

}  // namespace apvi::python
