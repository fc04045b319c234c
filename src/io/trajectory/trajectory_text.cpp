// SPDX-License-Identifier: BSD-3-Clause
#include "io/trajectory/trajectory_text.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/csv_file.hpp"

namespace apvi::io {
namespace {

using Cells = std::vector<std::string_view>;

// Tolerates quaternions printed with four decimals.
constexpr double kNormTolerance = 0.02;

// Column indices. Without a rotation, `xyzw` is unused.
struct Layout {
  std::array<std::size_t, 3> position{1, 2, 3};
  std::array<std::size_t, 4> xyzw{4, 5, 6, 7};
  bool seconds = true;
  bool has_rotation = true;
  std::size_t cells = 8;
};

struct Line {
  std::string_view text;
  const std::string& name;
  std::size_t number;

  [[noreturn]] void fail(std::string_view what) const {
    fail_input("{}:{}: {}", name, number, what);
  }
};

void split_at_blanks(std::string_view line, Cells& cells) {
  cells.clear();
  while (!(line = text::trim(line)).empty()) {
    const std::size_t end = std::min(line.find_first_of(" \t"), line.size());
    cells.push_back(line.substr(0, end));
    line.remove_prefix(end);
  }
}

std::string column_name(std::string_view cell) {
  if (cell.starts_with('#')) cell.remove_prefix(1);
  return text::to_lower(text::trim(cell.substr(0, cell.find('['))));
}

// Layout from the column names of a CSV header; nullopt when the line is only a comment.
std::optional<Layout> layout_of_header(const Line& line) {
  Cells cells;
  text::split(line.text, ',', cells);
  if (cells.size() < 4 || column_name(cells[0]) != "timestamp") return std::nullopt;
  const auto find = [&](std::initializer_list<std::string_view> names) {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (std::find(names.begin(), names.end(), column_name(cells[i])) != names.end()) return i;
    }
    return std::size_t{0};
  };
  Layout layout;
  layout.seconds = cells[0].find("[s]") != std::string_view::npos;
  layout.cells = cells.size();
  layout.position = {find({"p_x", "p_rs_r_x", "x", "pos_x", "east"}),
                     find({"p_y", "p_rs_r_y", "y", "pos_y", "north"}),
                     find({"p_z", "p_rs_r_z", "z", "pos_z", "up"})};
  layout.xyzw = {
      find({"q_x", "q_rs_x", "qx", "orient_qx"}), find({"q_y", "q_rs_y", "qy", "orient_qy"}),
      find({"q_z", "q_rs_z", "qz", "orient_qz"}), find({"q_w", "q_rs_w", "qw", "orient_qw"})};
  const auto absent = [](std::size_t column) { return column == 0; };
  if (std::any_of(layout.position.begin(), layout.position.end(), absent)) {
    line.fail("no position columns; expected p_x, p_y, p_z or east, north, up");
  }
  const auto missing = std::count_if(layout.xyzw.begin(), layout.xyzw.end(), absent);
  if (missing % 4 != 0) line.fail("some of the columns q_w, q_x, q_y, q_z are missing");
  layout.has_rotation = missing == 0;
  return layout;
}

// Layout from the first line of numbers, in a file without column names.
Layout layout_of_numbers(const Line& line) {
  Layout layout;
  if (line.text.find(',') == std::string_view::npos) return layout;
  layout.xyzw = {5, 6, 7, 4};  // EuRoC puts w first
  layout.seconds = false;
  return layout;
}

double number_in(const Line& line, const Cells& cells, std::size_t column) {
  const auto number = text::parse_double(cells[column]);
  if (!number) line.fail(fmt::format("\"{}\" is not a number", cells[column]));
  if (!std::isfinite(*number)) line.fail("number is not finite; delete the line");
  return *number;
}

Stamp stamp_in(const Line& line, std::string_view cell, bool seconds) {
  const auto ns = seconds ? text::parse_seconds_as_ns(cell) : text::parse_int64(cell);
  if (!ns || *ns > kMaxStampNs || *ns < -kMaxStampNs) {
    line.fail(fmt::format("\"{}\" is not a time in {}", cell, seconds ? "seconds" : "nanoseconds"));
  }
  return {*ns};
}

Eigen::Quaterniond rotation_in(const Line& line, const Cells& cells, const Layout& layout) {
  const auto at = [&](std::size_t i) { return number_in(line, cells, layout.xyzw[i]); };
  const Eigen::Quaterniond q(at(3), at(0), at(1), at(2));
  if (!(std::abs(q.norm() - 1.0) < kNormTolerance)) {
    line.fail(fmt::format("the quaternion has norm {:.4g}, not 1", q.norm()));
  }
  return q.normalized();
}

StampedPose pose_in(const Line& line, const Layout& layout, Cells& cells) {
  if (line.text.find(',') != std::string_view::npos) {
    text::split(line.text, ',', cells);
  } else {
    split_at_blanks(line.text, cells);
  }
  if (cells.size() < layout.cells) {
    line.fail(fmt::format("expected {} numbers, got {}{}", layout.cells, cells.size(),
                          layout.cells == 8 ? " (TUM: t tx ty tz qx qy qz qw)" : ""));
  }
  StampedPose pose{.stamp = stamp_in(line, cells[0], layout.seconds), .T_world_body = {}};
  for (std::size_t i = 0; i < 3; ++i) {
    pose.T_world_body.translation[static_cast<Eigen::Index>(i)] =
        number_in(line, cells, layout.position[i]);
  }
  if (layout.has_rotation) pose.T_world_body.rotation = rotation_in(line, cells, layout);
  return pose;
}

std::string_view without_byte_order_mark(std::string_view text) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (text.starts_with(kMark)) text.remove_prefix(kMark.size());
  return text;
}

bool is_header(std::string_view line) {
  return line.starts_with('#') || text::to_lower(line.substr(0, 9)) == "timestamp";
}

}  // namespace

Trajectory parse_trajectory(std::istream& in, const std::string& name) {
  Trajectory trajectory;
  std::optional<Layout> layout;
  std::string buffer;
  Cells cells;
  std::size_t number = 0;
  while (std::getline(in, buffer)) {
    const Line line{text::trim(without_byte_order_mark(buffer)), name, ++number};
    if (line.text.empty()) continue;
    if (is_header(line.text)) {
      if (!layout) layout = layout_of_header(line);
      continue;
    }
    if (!layout) layout = layout_of_numbers(line);
    const StampedPose pose = pose_in(line, *layout, cells);
    if (!trajectory.empty() && pose.stamp <= trajectory.poses.back().stamp) {
      line.fail("the time does not increase; sort the lines and delete duplicates");
    }
    trajectory.poses.push_back(pose);
  }
  if (number == 0) fail_input("{}: the file is empty", name);
  trajectory.has_rotation = !layout || layout->has_rotation;
  // GNSS at the surface writes zeros for the height.
  const auto flat = [](const StampedPose& p) { return p.T_world_body.translation.z() == 0.0; };
  trajectory.has_height = trajectory.has_rotation ||
                          !std::all_of(trajectory.poses.begin(), trajectory.poses.end(), flat);
  return trajectory;
}

}  // namespace apvi::io
