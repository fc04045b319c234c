// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <span>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/rosbag/dvl_message.hpp"
#include "io/rosbag/navsat.hpp"
#include "io/rosbag/ros_message.hpp"
#include "io/rosbag/ros_samples.hpp"

// A message definition, a NUL byte, and a message that may or may not be of that type, as bytes of
// ROS 1 and of ROS 2.

namespace {

using namespace apvi;

void use(const std::optional<SensorEvent>& event) {
  if (!event) return;
  is_finite(*event);
  if (const auto* image = std::get_if<ImageFrame>(&*event)) {
    try {
      fuzz::check(!image->decode().empty(), "an image has no pixels");
    } catch (const RunError&) {
    }
  }
}

void decode(const std::string& definition, io::RosWire wire, std::span<const std::uint8_t> bytes) {
  const io::RosMessageType type("fuzz_msgs/Message", definition, wire);
  const auto message = type.decode(bytes);
  if (!message) return;
  const Stamp stamp = io::stamp_of_message(*message, Stamp{1}).value_or(Stamp{1});
  use(io::imu_of(*message, stamp));
  use(io::dvl_of(*message, stamp));
  io::fix_of(*message);
  use(io::depth_of(*message, stamp));
  use(io::pressure_of({})(*message, stamp));
  use(io::image_of(0, "fuzz")(*message, stamp));
  io::pose_of(*message);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::uint8_t* end = std::find(data, data + size, std::uint8_t{0});
  const std::string definition(reinterpret_cast<const char*>(data),
                               static_cast<std::size_t>(end - data));
  const std::span<const std::uint8_t> rest(end, data + size);
  const auto bytes = rest.empty() ? rest : rest.subspan(1);
  for (const auto wire : {io::RosWire::ros1, io::RosWire::cdr}) {
    try {
      decode(definition, wire, bytes);
    } catch (const InputError&) {
    }
  }
  return 0;
}
