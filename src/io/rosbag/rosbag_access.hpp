// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// The only header that includes rosbag, with the traits that it needs to write our messages.
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cstdint>
#include <cstring>
#include <exception>
#include <pluginlib/exceptions.hpp>
#include <string>
#include <vector>

#include "io/rosbag/ros_definitions.hpp"

namespace apvi::io {

/// A serialized message of the given type.
struct RawMessage {
  const RosDefinition* definition;
  const std::vector<std::uint8_t>& bytes;
};

/// User-facing text of a rosbag exception: rosbag loads its encryption plugin even for unencrypted
/// bags, which requires files from the distribution's package.
inline std::string explain(const std::exception& e) {
  if (dynamic_cast<const pluginlib::PluginlibException*>(&e) != nullptr) {
    return "install the package librosbag-storage, which rosbag requires";
  }
  return e.what();
}

}  // namespace apvi::io

namespace ros {
namespace message_traits {

template <>
struct MD5Sum<apvi::io::RawMessage> {
  static const char* value(const apvi::io::RawMessage& m) { return m.definition->md5.c_str(); }
  static const char* value() { return "*"; }
};
template <>
struct DataType<apvi::io::RawMessage> {
  static const char* value(const apvi::io::RawMessage& m) { return m.definition->type.c_str(); }
  static const char* value() { return "*"; }
};
template <>
struct Definition<apvi::io::RawMessage> {
  static const char* value(const apvi::io::RawMessage& m) { return m.definition->text.c_str(); }
};

}  // namespace message_traits

namespace serialization {

template <>
struct Serializer<apvi::io::RawMessage> {
  template <typename Stream>
  static void write(Stream& stream, const apvi::io::RawMessage& message) {
    const auto size = static_cast<std::uint32_t>(message.bytes.size());
    if (size > 0) std::memcpy(stream.advance(size), message.bytes.data(), size);
  }
  // NOLINTNEXTLINE(readability-identifier-naming): the name that roscpp's serializer calls
  static std::uint32_t serializedLength(const apvi::io::RawMessage& message) {
    return static_cast<std::uint32_t>(message.bytes.size());
  }
};

}  // namespace serialization
}  // namespace ros
