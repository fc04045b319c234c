// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// Messages of ROS 1 and ROS 2 without ROS: a bag contains the definition of each message type,
/// which describes how to decode its bytes. Forks of a message with more or fewer fields can
/// therefore be read too.
namespace apvi::io {

/// How the values of a message become bytes: packed little-endian values of ROS 1, or those of
/// ROS 2 (OMG CDR, little- or big-endian), which pads each value to a multiple of its size.
enum class RosWire { ros1, cdr };

enum class RosPrimitive {
  none,
  boolean,
  int8,
  uint8,
  int16,
  uint16,
  int32,
  uint32,
  int64,
  uint64,
  float32,
  float64,
  text,
  time,
  duration
};

struct RosField {
  enum class Shape { single, fixed, variable };
  std::string name;
  RosPrimitive primitive = RosPrimitive::none;  // none: a record
  std::size_t record = 0;                       // index of the record's type
  Shape shape = Shape::single;
  std::size_t count = 1;  // of a fixed array
};

struct RosRecord {
  std::string name;  // "geometry_msgs/Vector3"
  std::vector<RosField> fields;
  std::size_t min_bytes = 0;  // size with all variable-length parts empty
};

/// A decoded value, a view into the bytes and the type that it was decoded with.
class RosValue {
 public:
  /// Member by path ("pose.pose.position.x"); null if absent.
  const RosValue* find(std::string_view path) const;
  /// The number, or element `index` of an array of numbers; nullopt for anything else, including
  /// times and durations (see `nanoseconds`).
  std::optional<double> number(std::size_t index = 0) const;
  std::optional<std::string_view> text() const;
  std::optional<std::int64_t> nanoseconds() const;
  /// The bytes of an array of 8-bit integers; empty for anything else.
  std::span<const std::uint8_t> bytes() const;
  /// Elements of an array of records or texts.
  const std::vector<RosValue>& items() const { return items_; }

  /// Number by path, for example `number_at("velocity.x")`.
  std::optional<double> number_at(std::string_view path) const;

 private:
  friend class RosDecoder;
  const RosRecord* record_ = nullptr;
  RosPrimitive primitive_ = RosPrimitive::none;
  bool big_endian_ = false;
  std::span<const std::uint8_t> bytes_;
  std::vector<RosValue> items_;  // members of a record, in the order of its fields, or elements
};

/// Layout of a message type.
class RosMessageType {
 public:
  /// `definition` as in a connection header: the text of the message, then those of nested types,
  /// each after lines of "=" and "MSG: package/Type". "package/msg/Type" is the same type. Throws
  /// InputError when it cannot be parsed or a nested type is missing.
  RosMessageType(const std::string& name, std::string_view definition,
                 RosWire wire = RosWire::ros1);

  /// Decodes a message; nullopt when the bytes do not match the definition.
  std::optional<RosValue> decode(std::span<const std::uint8_t> bytes) const;

  const std::string& name() const { return records_.front().name; }
  bool has_field(std::string_view name) const;
  const std::vector<RosRecord>& records() const { return records_; }

 private:
  std::vector<RosRecord> records_;  // the message itself is the first
  RosWire wire_;
};

/// "sensor_msgs/Imu" for "sensor_msgs/msg/Imu", as ROS 2 writes it; other names unchanged.
std::string ros_type_name(std::string_view name);

}  // namespace apvi::io
