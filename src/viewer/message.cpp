// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/message.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>

namespace apvi::viewer {
namespace {

using Json = nlohmann::json;

constexpr std::array<std::string_view, 5> kLayers = {"seen", "restored", "depth", "alpha",
                                                     "normals"};
constexpr double kMaxCoordinate = 1e7;  // [m]
constexpr double kMinThickness = 1e-4;  // of a section [m]

/// A message that is not one of the protocol; never leaves this file.
struct Malformed {};

double number(const Json& json, double min, double max) {
  if (!json.is_number()) throw Malformed{};
  const auto value = json.get<double>();
  if (!(value >= min && value <= max)) throw Malformed{};
  return value;
}

int integer(const Json& json, int min, int max) {
  if (!json.is_number_integer()) throw Malformed{};
  return static_cast<int>(number(json, min, max));
}

std::uint32_t id_of(const Json& json) {
  if (!json.is_number_unsigned()) throw Malformed{};
  return static_cast<std::uint32_t>(number(json, 0.0, 4294967295.0));
}

bool flag(const Json& json) {
  if (!json.is_boolean()) throw Malformed{};
  return json.get<bool>();
}

const Json& field(const Json& message, const char* name) {
  const auto found = message.find(name);
  if (found == message.end()) throw Malformed{};
  return *found;
}

template <std::size_t N>
std::array<double, N> numbers(const Json& json) {
  if (!json.is_array() || json.size() != N) throw Malformed{};
  std::array<double, N> v{};
  for (std::size_t i = 0; i < N; ++i) v.at(i) = number(json[i], -kMaxCoordinate, kMaxCoordinate);
  return v;
}

// [w, x, y, z, x, y, z]
SE3 pose_of(const Json& json) {
  const std::array<double, 7> v = numbers<7>(json);
  const Eigen::Quaterniond rotation(v[0], v[1], v[2], v[3]);
  if (!(std::abs(rotation.norm() - 1.0) < 0.01)) throw Malformed{};
  return {rotation.normalized(), {v[4], v[5], v[6]}};
}

// Absent in messages of programs that do not know it.
std::optional<Section> section_of(const Json& message) {
  const auto found = message.find("section");
  if (found == message.end() || found->is_null()) return std::nullopt;
  if (!found->is_object()) throw Malformed{};
  const std::array<double, 3> n = numbers<3>(field(*found, "normal"));
  const Eigen::Vector3d normal(n[0], n[1], n[2]);
  if (!(std::abs(normal.norm() - 1.0) < 0.01)) throw Malformed{};
  return Section{.normal = normal.normalized(),
                 .offset_m = number(field(*found, "offset"), -kMaxCoordinate, kMaxCoordinate),
                 .thickness_m = number(field(*found, "thickness"), kMinThickness, kMaxCoordinate)};
}

Viewpoint viewpoint_of(const Json& message) {
  const Viewpoint out{.width = integer(field(message, "width"), 1, kMaxSide),
                      .height = integer(field(message, "height"), 1, kMaxSide),
                      .focal = number(field(message, "focal"), 0.05, 50.0),
                      .T_world_camera = pose_of(field(message, "pose")),
                      .section = section_of(message)};
  if (out.width * out.height > kMaxPixels) throw Malformed{};
  return out;
}

Layer layer_of(const Json& json) {
  if (!json.is_string()) throw Malformed{};
  const auto& name = json.get_ref<const std::string&>();
  for (std::size_t i = 0; i < kLayers.size(); ++i) {
    if (name == kLayers.at(i)) return static_cast<Layer>(i);
  }
  throw Malformed{};
}

View view_of(const Json& message) {
  return {.viewpoint = viewpoint_of(message),
          .layer = layer_of(field(message, "layer")),
          .water = number(field(message, "water"), 0.0, 2.0)};
}

MeasureMessage measure_of(const Json& message) {
  MeasureMessage out{.id = id_of(field(message, "id")), .viewpoint = viewpoint_of(message)};
  out.column = integer(field(message, "column"), 0, out.viewpoint.width - 1);
  out.row = integer(field(message, "row"), 0, out.viewpoint.height - 1);
  return out;
}

Message message_of(const Json& json) {
  const Json& type = field(json, "type");
  if (type == "view") {
    return ViewMessage{id_of(field(json, "id")), view_of(json), flag(field(json, "moving"))};
  }
  if (type == "drawn") return DrawnMessage{id_of(field(json, "frame"))};
  if (type == "snapshot") return SnapshotMessage{id_of(field(json, "id")), view_of(json)};
  if (type == "measure") return measure_of(json);
  if (type == "save") return SaveMessage{};
  if (type == "pause") return PauseMessage{flag(field(json, "paused"))};
  throw Malformed{};
}

// Nesting is limited, since a parser that builds a tree frees it recursively.
bool too_deep(std::string_view text) {
  constexpr int kMaxDepth = 4;
  int depth = 0;
  for (const char c : text) {
    if (c == '[' || c == '{') ++depth;
    if (c == ']' || c == '}') --depth;
    if (depth > kMaxDepth) return true;
  }
  return false;
}

template <typename T>
void append(std::string& out, T value) {
  static_assert(std::endian::native == std::endian::little);
  const auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  out.append(bytes.data(), bytes.size());
}

}  // namespace

std::optional<Message> parse_message(std::string_view text) {
  if (text.size() > kMaxMessage || too_deep(text)) return std::nullopt;
  const Json json = Json::parse(text, nullptr, false);
  if (!json.is_object()) return std::nullopt;
  try {
    return message_of(json);
  } catch (const Malformed&) {
    return std::nullopt;
  }
}

std::string_view to_string(Layer layer) {
  return kLayers.at(static_cast<std::size_t>(layer));
}

std::string with_header(const ImageHeader& header, std::string_view image) {
  constexpr std::size_t kHeader = 24;
  std::string out;
  out.reserve(kHeader + image.size());
  append(out, static_cast<std::uint8_t>(header.kind));
  append(out, static_cast<std::uint8_t>(header.layer));
  append(out, static_cast<std::uint8_t>(header.complete));
  append(out, std::uint8_t{0});
  append(out, header.id);
  append(out, header.view);
  append(out, static_cast<std::uint16_t>(header.width));
  append(out, static_cast<std::uint16_t>(header.height));
  append(out, header.near_m);
  append(out, header.far_m);
  out.append(image);
  return out;
}

std::string point_message(std::uint32_t id, const std::optional<Eigen::Vector3d>& point,
                          double range_m) {
  Json json{{"type", "point"}, {"id", id}, {"point", nullptr}};
  if (point) {
    json["point"] = {point->x(), point->y(), point->z()};
    json["range_m"] = range_m;
  }
  return json.dump();
}

}  // namespace apvi::viewer
