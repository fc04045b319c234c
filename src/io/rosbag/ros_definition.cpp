// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/rosbag/ros_message.hpp"

// The parser of message definitions.
namespace apvi::io {
namespace {

constexpr std::size_t kMaxDepth = 16;           // of nested records
constexpr std::size_t kMaxFixed = 1U << 24U;    // elements of a fixed array
constexpr std::size_t kMaxBytes = 1ULL << 32U;  // no message is larger: lengths have 32 bits

constexpr std::array<std::pair<std::string_view, RosPrimitive>, 18> kPrimitives = {{
    {"bool", RosPrimitive::boolean},
    {"int8", RosPrimitive::int8},
    {"uint8", RosPrimitive::uint8},
    {"byte", RosPrimitive::int8},
    {"char", RosPrimitive::uint8},
    {"int16", RosPrimitive::int16},
    {"uint16", RosPrimitive::uint16},
    {"int32", RosPrimitive::int32},
    {"uint32", RosPrimitive::uint32},
    {"int64", RosPrimitive::int64},
    {"uint64", RosPrimitive::uint64},
    {"float32", RosPrimitive::float32},
    {"float64", RosPrimitive::float64},
    {"string", RosPrimitive::text},
    {"time", RosPrimitive::time},
    {"duration", RosPrimitive::duration},
    {"builtin_interfaces/Time", RosPrimitive::time},
    {"builtin_interfaces/Duration", RosPrimitive::duration},
}};

RosPrimitive primitive_of(std::string_view word) {
  const auto it = std::find_if(kPrimitives.begin(), kPrimitives.end(),
                               [&](const auto& entry) { return entry.first == word; });
  return it == kPrimitives.end() ? RosPrimitive::none : it->second;
}

struct ParsedField {
  RosField field;
  std::string type;  // as written, without brackets
};

struct ParsedRecord {
  std::string name;
  std::vector<ParsedField> fields;
};

std::string_view package_of(std::string_view name) {
  return name.substr(0, name.find('/'));
}

// For example, "float64[9]" is a fixed array of 9 float64. The limits of ROS 2, "string<=9" and
// "float64[<=9]", do not affect the layout.
void parse_type(std::string_view word, const std::string& record, ParsedField& parsed) {
  const std::size_t open = word.find('[');
  const std::string_view element = word.substr(0, open);
  parsed.type = ros_type_name(element.substr(0, element.find("<=")));
  if (open == std::string_view::npos) return;
  const std::string_view inside = word.substr(open + 1, word.size() - open - 2);
  if (word.back() == ']' && (inside.empty() || inside.starts_with("<="))) {
    parsed.field.shape = RosField::Shape::variable;
    return;
  }
  const auto count = text::parse_int64(inside);
  if (word.back() != ']' || !count || *count < 0 || *count > static_cast<std::int64_t>(kMaxFixed)) {
    fail_input("message definition of {}: cannot read the type \"{}\"", record, word);
  }
  parsed.field.shape = RosField::Shape::fixed;
  parsed.field.count = static_cast<std::size_t>(*count);
}

void parse_line(std::string_view line, RosWire wire, ParsedRecord& record) {
  line = text::trim(line.substr(0, line.find('#')));
  if (line.empty()) return;
  const std::size_t blank = line.find_first_of(" \t");
  const std::string_view rest =
      blank == std::string_view::npos ? std::string_view{} : text::trim(line.substr(blank));
  const std::string_view name = rest.substr(0, rest.find_first_of(" \t="));
  const std::string_view value = text::trim(rest.substr(name.size()));
  if (value.starts_with('=')) return;  // a constant takes no bytes
  const bool has_default = wire == RosWire::cdr && !value.empty();
  if (name.empty() || (!value.empty() && !has_default)) {
    fail_input("message definition of {}: cannot read the line \"{}\"", record.name, line);
  }
  ParsedField parsed;
  parsed.field.name = std::string(name);
  parse_type(line.substr(0, blank), record.name, parsed);
  record.fields.push_back(std::move(parsed));
}

// CDR has no empty records: ROS 2 gives them a member.
void fill_empty(ParsedRecord& record) {
  if (!record.fields.empty()) return;
  ParsedField parsed;
  parsed.field.name = "structure_needs_at_least_one_member";
  parsed.type = "uint8";
  record.fields.push_back(std::move(parsed));
}

std::vector<ParsedRecord> parse_blocks(const std::string& name, std::string_view definition,
                                       RosWire wire) {
  std::vector<ParsedRecord> blocks(1);
  blocks.back().name = ros_type_name(name);
  while (!definition.empty()) {
    const std::size_t end = std::min(definition.find('\n'), definition.size());
    const std::string_view line = text::trim(definition.substr(0, end));
    definition.remove_prefix(std::min(end + 1, definition.size()));
    if (line.starts_with("====")) continue;
    if (line.starts_with("MSG:")) {
      blocks.emplace_back();
      blocks.back().name = ros_type_name(text::trim(line.substr(4)));
    } else {
      parse_line(line, wire, blocks.back());
    }
  }
  if (wire == RosWire::cdr) std::for_each(blocks.begin(), blocks.end(), fill_empty);
  return blocks;
}

// Resolves type names to indices, depth first, and computes minimum sizes in bytes.
class Resolver {
 public:
  Resolver(const std::vector<ParsedRecord>& blocks, std::vector<RosRecord>& records)
      : blocks_(blocks), records_(records) {
    records_.resize(blocks_.size());
    for (std::size_t i = 0; i < blocks_.size(); ++i) index_.emplace(blocks_[i].name, i);
  }

  void resolve(std::size_t block, std::size_t depth) {
    if (depth > kMaxDepth) {
      fail_input("message definition of {}: recursive types", blocks_[block].name);
    }
    RosRecord& record = records_[block];
    if (!record.name.empty()) return;  // already resolved
    std::size_t bytes = 0;
    for (const ParsedField& parsed : blocks_[block].fields) {
      RosField field = parsed.field;
      field.primitive = primitive_of(parsed.type);
      if (field.primitive == RosPrimitive::none) {
        field.record = find(parsed.type, blocks_[block].name);
        resolve(field.record, depth + 1);
      }
      bytes = std::min(kMaxBytes, bytes + min_bytes_of(field));
      record.fields.push_back(std::move(field));
    }
    record.min_bytes = bytes;
    record.name = blocks_[block].name;
  }

 private:
  std::size_t find(const std::string& type, const std::string& inside) const {
    for (const std::string& name : {type, type == "Header" ? std::string("std_msgs/Header") : type,
                                    fmt::format("{}/{}", package_of(inside), type)}) {
      if (const auto it = index_.find(name); it != index_.end()) return it->second;
    }
    fail_input("message definition of {}: no definition of its type {}", inside, type);
  }

  std::size_t min_bytes_of(const RosField& field) const;

  const std::vector<ParsedRecord>& blocks_;
  std::vector<RosRecord>& records_;
  std::map<std::string, std::size_t> index_;
};

}  // namespace

std::size_t bytes_of(RosPrimitive primitive) {
  switch (primitive) {
    case RosPrimitive::none:
      return 0;
    case RosPrimitive::boolean:
    case RosPrimitive::int8:
    case RosPrimitive::uint8:
      return 1;
    case RosPrimitive::int16:
    case RosPrimitive::uint16:
      return 2;
    case RosPrimitive::int32:
    case RosPrimitive::uint32:
    case RosPrimitive::float32:
    case RosPrimitive::text:
      return 4;  // a text: its length prefix
    case RosPrimitive::int64:
    case RosPrimitive::uint64:
    case RosPrimitive::float64:
    case RosPrimitive::time:
    case RosPrimitive::duration:
      return 8;
  }
  return 0;
}

std::size_t Resolver::min_bytes_of(const RosField& field) const {
  if (field.shape == RosField::Shape::variable) return 4;
  const std::size_t one = field.primitive == RosPrimitive::none ? records_[field.record].min_bytes
                                                                : bytes_of(field.primitive);
  return std::min(kMaxBytes, one * field.count);
}

std::string ros_type_name(std::string_view name) {
  std::string type(name);
  if (const std::size_t msg = type.find("/msg/"); msg != std::string::npos) type.erase(msg, 4);
  return type;
}

RosMessageType::RosMessageType(const std::string& name, std::string_view definition, RosWire wire)
    : wire_(wire) {
  const std::vector<ParsedRecord> blocks = parse_blocks(name, definition, wire);
  Resolver(blocks, records_).resolve(0, 0);
}

bool RosMessageType::has_field(std::string_view name) const {
  const auto& fields = records_.front().fields;
  return std::any_of(fields.begin(), fields.end(),
                     [&](const RosField& field) { return field.name == name; });
}

}  // namespace apvi::io
