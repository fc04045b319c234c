// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

/// Which column of a table holds the time, and in which unit its name says so.
namespace apvi::io {

/// The unit that a column's name is or ends in: "ns" of "time_ns" or "ns"; "" when there is none.
std::string time_unit_in_name(const std::string& name);

/// Whether a column of this name holds the time; `has_unit` tells that a unit follows the name.
bool is_time_name(const std::string& name, bool has_unit);

/// Whether a name mentions time without being one of the usual names: "ros_time", "frame stamp".
bool may_be_time(const std::string& name);

/// The first of these columns, unless its name is not that of a time and another one's is: tables
/// may begin with a row number. `units` are those that follow the names.
std::size_t find_time_column(const std::vector<std::string>& columns,
                             const std::vector<std::string>& units);

}  // namespace apvi::io
