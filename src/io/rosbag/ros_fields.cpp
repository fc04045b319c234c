// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/ros_fields.hpp"

namespace apvi::io {

const RosValue* first_of(const RosValue& message, std::initializer_list<std::string_view> paths) {
  for (const std::string_view path : paths) {
    if (const RosValue* value = message.find(path)) return value;
  }
  return nullptr;
}

std::optional<Eigen::Vector3d> vector_of(const RosValue* value) {
  if (value == nullptr) return std::nullopt;
  const auto x = value->number_at("x");
  const auto y = value->number_at("y");
  const auto z = value->number_at("z");
  if (!x || !y || !z) return std::nullopt;
  return Eigen::Vector3d(*x, *y, *z);
}

}  // namespace apvi::io
