// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <initializer_list>
#include <optional>
#include <string_view>

#include "io/rosbag/ros_message.hpp"

namespace apvi::io {

/// The first of these members that the message has; null if none.
const RosValue* first_of(const RosValue& message, std::initializer_list<std::string_view> paths);
/// The members x, y and z; nullopt when the value is null or lacks one.
std::optional<Eigen::Vector3d> vector_of(const RosValue* value);

}  // namespace apvi::io
