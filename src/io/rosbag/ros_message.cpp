// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/ros_message.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

namespace apvi::io {

std::size_t bytes_of(RosPrimitive primitive);  // ros_definition.cpp

namespace {

// Limits memory for definitions with many zero-size values.
constexpr std::size_t kMaxValues = 200'000;

// The supported hosts are little-endian.
template <typename T>
T load(std::span<const std::uint8_t> bytes, bool big_endian) {
  std::array<std::uint8_t, sizeof(T)> copy;
  std::memcpy(copy.data(), bytes.data(), sizeof(T));
  if (big_endian) std::reverse(copy.begin(), copy.end());
  return std::bit_cast<T>(copy);
}

double load_number(RosPrimitive primitive, std::span<const std::uint8_t> at, bool big) {
  switch (primitive) {
    case RosPrimitive::int8:
      return load<std::int8_t>(at, big);
    case RosPrimitive::int16:
      return load<std::int16_t>(at, big);
    case RosPrimitive::uint16:
      return load<std::uint16_t>(at, big);
    case RosPrimitive::int32:
      return load<std::int32_t>(at, big);
    case RosPrimitive::uint32:
      return load<std::uint32_t>(at, big);
    case RosPrimitive::int64:
      return static_cast<double>(load<std::int64_t>(at, big));
    case RosPrimitive::uint64:
      return static_cast<double>(load<std::uint64_t>(at, big));
    case RosPrimitive::float32:
      return static_cast<double>(load<float>(at, big));
    case RosPrimitive::float64:
      return load<double>(at, big);
    default:
      return load<std::uint8_t>(at, big);
  }
}

// A time is two numbers of four bytes.
std::size_t alignment_of(RosPrimitive primitive) {
  const bool is_time = primitive == RosPrimitive::time || primitive == RosPrimitive::duration;
  return is_time ? 4 : bytes_of(primitive);
}

bool is_number(RosPrimitive primitive) {
  return primitive != RosPrimitive::none && primitive < RosPrimitive::text;
}

}  // namespace

/// Decodes the bytes of one message along the fields of its type.
class RosDecoder {
 public:
  RosDecoder(const std::vector<RosRecord>& records, RosWire wire,
             std::span<const std::uint8_t> bytes)
      : records_(records), wire_(wire), rest_(bytes) {}

  // CDR begins with its representation, 0 for big and 1 for little endian, and two bytes of
  // options. Representations of other layouts do not occur in bags.
  bool decode_prefix() {
    if (wire_ == RosWire::ros1) return true;
    std::span<const std::uint8_t> prefix;
    if (!read_bytes(4, prefix) || prefix[0] != 0 || prefix[1] > 1) return false;
    big_endian_ = prefix[1] == 0;
    size_ = rest_.size();
    return true;
  }

  bool decode_record(const RosRecord& record, RosValue& value) {
    value.record_ = &record;
    if (!make_items(record.fields.size(), value)) return false;
    for (std::size_t i = 0; i < record.fields.size(); ++i) {
      if (!decode_field(record.fields[i], value.items_[i])) return false;
    }
    return true;
  }
  // Some implementations pad the end of a CDR message to a multiple of four bytes.
  bool at_end() const { return rest_.size() < (wire_ == RosWire::cdr ? 4 : 1); }

 private:
  bool read_bytes(std::size_t count, std::span<const std::uint8_t>& taken) {
    if (count > rest_.size()) return false;
    taken = rest_.first(count);
    rest_ = rest_.subspan(count);
    return true;
  }
  bool align(std::size_t alignment) {
    if (wire_ == RosWire::ros1) return true;
    const std::size_t position = size_ - rest_.size();
    std::span<const std::uint8_t> padding;
    return read_bytes((alignment - position % alignment) % alignment, padding);
  }
  bool read_length(std::size_t& length) {
    std::span<const std::uint8_t> bytes;
    if (!align(4) || !read_bytes(4, bytes)) return false;
    length = load<std::uint32_t>(bytes, big_endian_);
    return true;
  }
  bool read_text(RosValue& value) {
    std::size_t length = 0;
    if (!read_length(length) || !read_bytes(length, value.bytes_)) return false;
    const bool terminated = wire_ == RosWire::cdr && length > 0 && value.bytes_.back() == 0;
    if (terminated) value.bytes_ = value.bytes_.first(length - 1);
    return true;
  }
  // CDR does not align an empty array.
  bool read_numbers(RosPrimitive primitive, std::size_t count, RosValue& value) {
    value.big_endian_ = big_endian_;
    return (count == 0 || align(alignment_of(primitive))) &&
           read_bytes(count * bytes_of(primitive), value.bytes_);
  }

  bool make_items(std::size_t count, RosValue& value) {
    if (count > kMaxValues - values_) return false;
    values_ += count;
    value.items_.resize(count);
    return true;
  }

  bool decode_one(const RosField& field, RosValue& value) {
    value.primitive_ = field.primitive;
    if (field.primitive == RosPrimitive::none) return decode_record(records_[field.record], value);
    if (field.primitive == RosPrimitive::text) return read_text(value);
    return read_numbers(field.primitive, 1, value);
  }

  bool decode_field(const RosField& field, RosValue& value) {
    if (field.shape == RosField::Shape::single) return decode_one(field, value);
    std::size_t count = field.count;
    if (field.shape == RosField::Shape::variable && !read_length(count)) return false;
    value.primitive_ = field.primitive;
    const bool plain =
        field.primitive != RosPrimitive::none && field.primitive != RosPrimitive::text;
    if (plain) return read_numbers(field.primitive, count, value);
    const std::size_t min_bytes = field.primitive == RosPrimitive::none
                                      ? records_[field.record].min_bytes
                                      : bytes_of(field.primitive);
    // Reject lengths that exceed the message before allocating.
    if (count > kMaxValues || count * min_bytes > rest_.size() || !make_items(count, value))
      return false;
    return std::all_of(value.items_.begin(), value.items_.end(),
                       [&](RosValue& item) { return decode_one(field, item); });
  }

  const std::vector<RosRecord>& records_;
  RosWire wire_;
  std::span<const std::uint8_t> rest_;
  std::size_t size_ = 0;  // of the bytes that alignment refers to
  bool big_endian_ = false;
  std::size_t values_ = 0;
};

std::optional<RosValue> RosMessageType::decode(std::span<const std::uint8_t> bytes) const {
  RosDecoder decoder(records_, wire_, bytes);
  RosValue value;
  if (!decoder.decode_prefix() || !decoder.decode_record(records_.front(), value) ||
      !decoder.at_end()) {
    return std::nullopt;
  }
  return value;
}

const RosValue* RosValue::find(std::string_view path) const {
  const RosValue* value = this;
  while (value != nullptr && !path.empty()) {
    const std::size_t dot = std::min(path.find('.'), path.size());
    const std::string_view name = path.substr(0, dot);
    path.remove_prefix(std::min(dot + 1, path.size()));
    if (value->record_ == nullptr) return nullptr;
    const auto& fields = value->record_->fields;
    const auto it = std::find_if(fields.begin(), fields.end(),
                                 [&](const RosField& field) { return field.name == name; });
    value = it == fields.end() ? nullptr
                               : &value->items_[static_cast<std::size_t>(it - fields.begin())];
  }
  return value;
}

std::optional<double> RosValue::number(std::size_t index) const {
  if (!is_number(primitive_)) return std::nullopt;
  const std::size_t size = bytes_of(primitive_);
  if (index >= bytes_.size() / size) return std::nullopt;
  return load_number(primitive_, bytes_.subspan(index * size, size), big_endian_);
}

std::optional<double> RosValue::number_at(std::string_view path) const {
  const RosValue* value = find(path);
  return value == nullptr ? std::nullopt : value->number();
}

std::optional<std::string_view> RosValue::text() const {
  if (primitive_ != RosPrimitive::text || !items_.empty()) return std::nullopt;
  return std::string_view(reinterpret_cast<const char*>(bytes_.data()), bytes_.size());
}

std::optional<std::int64_t> RosValue::nanoseconds() const {
  if (primitive_ != RosPrimitive::time || bytes_.size() != 8) return std::nullopt;
  return std::int64_t{load<std::uint32_t>(bytes_, big_endian_)} * 1'000'000'000 +
         load<std::uint32_t>(bytes_.subspan(4), big_endian_);
}

std::span<const std::uint8_t> RosValue::bytes() const {
  const bool eight_bits = primitive_ == RosPrimitive::uint8 || primitive_ == RosPrimitive::int8;
  return eight_bits ? bytes_ : std::span<const std::uint8_t>{};
}

}  // namespace apvi::io
