// SPDX-License-Identifier: BSD-3-Clause
#include "io/trajectory/trajectory_layout.hpp"

#include <algorithm>
#include <initializer_list>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/csv_cells.hpp"
#include "io/folder/time_column.hpp"
#include "io/folder/units.hpp"

namespace apvi::io {
namespace {

using Words = std::initializer_list<std::string_view>;

struct Column {
  std::string name;
  std::string unit;
};

bool is_in(std::string_view word, Words words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

void split_at_blanks(std::string_view line, Cells& cells) {
  cells.clear();
  while (!(line = text::trim(line)).empty()) {
    const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
    cells.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
}

// Column names with units. Between blanks a unit may be a cell of its own.
std::vector<Column> columns_of(std::string_view line) {
  while (!line.empty() && (line.front() == '#' || line.front() == '%')) line.remove_prefix(1);
  Cells cells;
  split_trajectory_line(line, cells);
  std::vector<Column> columns;
  for (const std::string_view cell : cells) {
    auto [name, unit] = split_unit(cell);
    if (name.empty() && !columns.empty()) {
      columns.back().unit = unit;
    } else {
      columns.push_back({std::move(name), std::move(unit)});
    }
  }
  return columns;
}

// The unit of a time column, in brackets or appended ("time_ns"); "" when not stated.
std::string time_unit_of(const Column& column) {
  return column.unit.empty() ? time_unit_in_name(column.name) : column.unit;
}

bool is_time(const Column& column) {
  return is_time_name(column.name, !column.unit.empty());
}

// The part of a name before its axis: "p_rs_r" of "p_rs_r_x", "q" of "qx"; nullopt for other axes.
std::optional<std::string> stem_of(const std::string& name, char axis) {
  if (name.empty() || name.back() != axis) return std::nullopt;
  std::string stem = name.substr(0, name.size() - 1);
  while (!stem.empty() && is_in(stem.substr(stem.size() - 1), {"_", ".", "/"})) stem.pop_back();
  return stem;
}

bool is_position_stem(const std::string& stem) {
  return is_in(stem, {"", "p", "t", "pos", "position", "translation", "trans"}) ||
         stem.starts_with("p_") || stem.ends_with("position") || stem.ends_with("translation");
}

bool is_rotation_stem(const std::string& stem) {
  return is_in(stem, {"q", "quat", "quaternion", "orient_q", "rot", "rotation", "r"}) ||
         stem.starts_with("q_") || stem.ends_with("orientation") || stem.ends_with("rotation") ||
         stem.ends_with("_q") || stem.ends_with("quaternion");
}

template <typename IsStem>
std::optional<std::size_t> find_axis(const std::vector<Column>& columns, char axis,
                                     IsStem&& is_stem) {
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const auto stem = stem_of(columns[i].name, axis);
    if (stem && is_stem(*stem)) return i;
  }
  return std::nullopt;
}

std::optional<std::size_t> find_position(const std::vector<Column>& columns, std::size_t axis) {
  constexpr std::array<std::string_view, 3> kGnss = {"east", "north", "up"};
  if (const auto i = find_axis(columns, "xyz"[axis], is_position_stem)) return i;
  const auto it = std::find_if(columns.begin(), columns.end(),
                               [&](const Column& c) { return c.name == kGnss[axis]; });
  if (it == columns.end()) return std::nullopt;
  return static_cast<std::size_t>(it - columns.begin());
}

std::optional<std::size_t> find_name(const std::vector<Column>& columns, Words names) {
  const auto it = std::find_if(columns.begin(), columns.end(),
                               [&](const Column& c) { return is_in(c.name, names); });
  if (it == columns.end()) return std::nullopt;
  return static_cast<std::size_t>(it - columns.begin());
}

// False when there are no latitude, longitude and altitude.
bool find_geodetic(const std::vector<Column>& columns, TrajectoryLayout& layout) {
  const auto latitude = find_name(columns, {"latitude", "lat"});
  const auto longitude = find_name(columns, {"longitude", "lon", "lng", "long"});
  const auto altitude = find_name(columns, {"altitude", "alt", "height"});
  if (!latitude || !longitude || !altitude) return false;
  layout.position = {*latitude, *longitude, *altitude};
  layout.is_geodetic = true;
  return true;
}

const Unit& unit_of(const Column& column, const std::string& word, Dimension dimension,
                    const std::string& where) {
  if (const Unit* unit = find_unit(dimension, word)) return *unit;
  fail_input("{}: column {}: unknown unit [{}]; known here: {}", where, column.name, word,
             known_units(dimension));
}

// False when there are none of its four columns.
bool find_rotation(const std::vector<Column>& columns, const std::string& where,
                   TrajectoryLayout& layout) {
  std::size_t found = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto column = find_axis(columns, "xyzw"[i], is_rotation_stem);
    layout.xyzw[i] = column.value_or(0);
    found += column ? 1 : 0;
  }
  if (found % 4 != 0) fail_input("{}: some of the columns q_w, q_x, q_y, q_z are missing", where);
  return found == 4;
}

// False when the line is a remark.
bool find_positions(const std::vector<Column>& columns, std::string_view line,
                    const std::string& where, TrajectoryLayout& layout) {
  if (find_geodetic(columns, layout)) return true;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto column = find_position(columns, i);
    if (!column && line.find_first_of(",;") == std::string_view::npos) return false;
    if (!column) {
      fail_input(
          "{}: no position columns; expected p_x, p_y, p_z, or east, north, up, or latitude, "
          "longitude, altitude",
          where);
    }
    layout.position[i] = *column;
    const Column& named = columns[*column];
    if (!named.unit.empty())
      layout.to_meters[i] = unit_of(named, named.unit, Dimension::length, where).to_si;
  }
  return true;
}

}  // namespace

void split_trajectory_line(std::string_view line, Cells& cells) {
  line = text::trim(line);
  const bool semicolons = line.find(';') != std::string_view::npos;  // then commas are decimal
  if (!semicolons && line.find(',') == std::string_view::npos) return split_at_blanks(line, cells);
  split_quoted(line, semicolons ? ';' : ',', cells);
  while (cells.size() > 1 && cells.back().empty()) cells.pop_back();
}

std::optional<TrajectoryLayout> layout_of_header(std::string_view line, const std::string& where) {
  const std::vector<Column> columns = columns_of(line);
  const auto time = std::find_if(columns.begin(), columns.end(), is_time);
  if (columns.size() < 4 || time == columns.end()) return std::nullopt;
  TrajectoryLayout layout;
  layout.stamp = static_cast<std::size_t>(time - columns.begin());
  if (!find_positions(columns, line, where, layout)) return std::nullopt;
  layout.has_rotation = find_rotation(columns, where, layout);
  const std::string unit = time_unit_of(*time);
  if (!unit.empty()) layout.time_power = unit_of(*time, unit, Dimension::time, where).time_power;
  const bool blanks = line.find_first_of(",;") == std::string_view::npos;
  layout.usual_time_power = blanks ? 9 : 0;
  layout.cells = columns.size();
  return layout;
}

TrajectoryLayout layout_of_numbers(std::string_view line, const std::string& where) {
  TrajectoryLayout layout;
  layout.has_names = false;
  Cells cells;
  split_trajectory_line(line, cells);
  if (line.find_first_of(",;") != std::string_view::npos) {
    layout.xyzw = {5, 6, 7, 4};  // EuRoC puts w first
    layout.usual_time_power = 0;
  } else if (cells.size() == 12 || cells.size() == 16) {
    fail_input(
        "{}: {} numbers without a header: matrices, as KITTI has them, have no stamps; "
        "convert them to TUM (t tx ty tz qx qy qz qw)",
        where, cells.size());
  }
  return layout;
}

}  // namespace apvi::io
