// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/time_column.hpp"

#include <algorithm>
#include <array>
#include <string_view>

#include "io/folder/units.hpp"

namespace apvi::io {
namespace {

constexpr std::array<std::string_view, 19> kNames = {
    "timestamp", "timestamps", "time",     "t",        "stamp",    "stamps", "sec",
    "secs",      "seconds",    "ns",       "us",       "ms",       "utime",  "header.stamp",
    "__time",    "utc",        "utc_time", "datetime", "date_time"};

}  // namespace

std::string time_unit_in_name(const std::string& name) {
  const std::size_t underscore = name.rfind('_');
  const bool appended = underscore != std::string::npos;
  const std::string word = appended ? name.substr(underscore + 1) : name;
  const bool known = find_unit(Dimension::time, word) != nullptr && (appended || word != "s");
  return known ? word : "";
}

bool is_time_name(const std::string& name, bool has_unit) {
  const std::size_t underscore = std::min(name.rfind('_'), name.size());
  const std::string stem =
      has_unit || time_unit_in_name(name).empty() ? name : name.substr(0, underscore);
  return std::find(kNames.begin(), kNames.end(), stem) != kNames.end();
}

bool may_be_time(const std::string& name) {
  return name.find("time") != std::string::npos || name.find("stamp") != std::string::npos;
}

std::size_t find_time_column(const std::vector<std::string>& columns,
                             const std::vector<std::string>& units) {
  const auto is_time = [&](std::size_t i) { return is_time_name(columns[i], !units[i].empty()); };
  if (is_time(0) || may_be_time(columns[0])) return 0;
  for (std::size_t i = 1; i < columns.size(); ++i) {
    if (is_time(i)) return i;
  }
  const auto date = std::find(columns.begin(), columns.end(), "date");
  return date == columns.end() ? 0 : static_cast<std::size_t>(date - columns.begin());
}

}  // namespace apvi::io
