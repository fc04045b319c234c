// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// The one place that includes rosbag, and what it must know of our messages to write them.
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cstdint>
#include <cstring>
#include <exception>
#include <pluginlib/exceptions.hpp>
#include <string>
#include <vector>

#include "io/ros_definitions.hpp"

namespace apvi::io {

/// Bytes that are a message of the given type.
struct RawMessage {
  const RosDefinition* definition;
  const std::vector<std::uint8_t>& bytes;
};

/// What an exception of rosbag means to the user: it asks its plugin loader for encryption even
/// when nothing is encrypted, and that needs files which only the distribution's package brings.
inline std::string explain(const std::exception& e) {
  if (dynamic_cast<const pluginlib::PluginlibException*>(&e) != nullptr) {
    return "bags need the package librosbag-storage, which is not installed here";
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
