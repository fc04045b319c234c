// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace apvi::io {

using Cells = std::vector<std::string_view>;

/// Column indices of a trajectory file. Without a rotation, `xyzw` is unused.
struct TrajectoryLayout {
  std::size_t stamp = 0;
  std::array<std::size_t, 3> position{1, 2, 3};
  std::array<std::size_t, 4> xyzw{4, 5, 6, 7};
  std::array<double, 3> to_meters{1.0, 1.0, 1.0};
  std::optional<int> time_power;  ///< of ten nanoseconds; nullopt: not stated
  int usual_time_power = 9;       ///< when neither stated nor told by the stamps
  bool has_names = true;          ///< of its columns; else the order is that of the format
  bool has_rotation = true;
  bool is_geodetic = false;  ///< `position` is latitude, longitude [deg] and altitude
  std::size_t cells = 8;     ///< required in a line
};

/// The cells of a line: separated by semicolon, else by comma, else by blanks; a separator at the
/// end adds none.
void split_trajectory_line(std::string_view line, Cells& cells);

/// The columns that a header names, in any order and in the spelling of any usual program
/// ("p_RS_R_x [m]", "tx", "pose.position.x"), or latitude, longitude and altitude. nullopt when the
/// line is no header but a remark. Throws InputError that begins with `where` for a header with a
/// time but without positions, with a part of a quaternion, or with an unknown unit.
std::optional<TrajectoryLayout> layout_of_header(std::string_view line, const std::string& where);

/// The layout by the number of cells and the separator, in a file without column names. Throws
/// InputError for matrices without stamps (KITTI).
TrajectoryLayout layout_of_numbers(std::string_view line, const std::string& where);

}  // namespace apvi::io
