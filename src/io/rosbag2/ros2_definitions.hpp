// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace apvi::io {

/// The definitions of a ROS 2 message type with its nested types, for bags that do not contain them
/// (sqlite3 before ROS 2 Iron). Several where versions of a package differ. Empty for types that no
/// sensor uses.
std::vector<std::string> ros2_definitions(std::string_view type);

/// A nested type as it follows in a definition.
std::string ros2_section(std::string_view type, std::string_view text);
/// All types as nested types.
std::string ros2_sections();

}  // namespace apvi::io
