// SPDX-License-Identifier: BSD-3-Clause
#include "io/trajectory/trajectory_text.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/date_time.hpp"
#include "core/text.hpp"
#include "io/folder/csv_cells.hpp"
#include "io/folder/csv_file.hpp"
#include "io/folder/row_order.hpp"
#include "io/folder/units.hpp"
#include "io/rosbag/navsat.hpp"
#include "io/trajectory/quaternion_order.hpp"
#include "io/trajectory/trajectory_layout.hpp"

namespace apvi::io {
namespace {

// Tolerates quaternions printed with four decimals.
constexpr double kNormTolerance = 0.02;
constexpr std::size_t kFewLines = 20;  // less say nothing about lost digits

struct Line {
  std::string text;
  const std::string& name;
  std::size_t number;

  std::string where() const { return fmt::format("{}:{}", name, number); }
  [[noreturn]] void fail(std::string_view what) const { fail_input("{}: {}", where(), what); }
};

// The lines that hold poses, and how to read them.
struct Content {
  std::vector<Line> lines;
  TrajectoryLayout layout;
  bool is_empty = true;
};

double number_in(const Line& line, const Cells& cells, std::size_t column) {
  const auto number = text::parse_double(with_decimal_point(cells[column]));
  if (!number) line.fail(fmt::format("\"{}\" is not a number", cells[column]));
  if (!std::isfinite(*number)) line.fail("number is not finite; delete the line");
  return *number;
}

std::string_view name_of_power(int power) {
  return power == 9 ? "seconds" : power == 6 ? "ms" : power == 3 ? "us" : "nanoseconds";
}

Stamp stamp_in(const Line& line, std::string_view cell, int power) {
  if (const auto date = parse_date_time(cell)) return *date;
  const auto ns = text::parse_scaled_int64(with_decimal_point(cell), power);
  if (!ns || *ns > kMaxStampNs || *ns < -kMaxStampNs) {
    line.fail(fmt::format("\"{}\" is not a time in {}", cell, name_of_power(power)));
  }
  return {*ns};
}

Eigen::Quaterniond rotation_in(const Line& line, const Cells& cells,
                               const TrajectoryLayout& layout) {
  const auto at = [&](std::size_t i) { return number_in(line, cells, layout.xyzw[i]); };
  const Eigen::Quaterniond q(at(3), at(0), at(1), at(2));
  if (!(std::abs(q.norm() - 1.0) < kNormTolerance)) {
    line.fail(fmt::format("the quaternion has norm {:.4g}, not 1", q.norm()));
  }
  return q.normalized();
}

StampedPose pose_in(const Line& line, const TrajectoryLayout& layout, Cells& cells) {
  split_trajectory_line(line.text, cells);
  if (cells.size() < layout.cells) {
    line.fail(fmt::format("expected {} numbers, got {}{}", layout.cells, cells.size(),
                          layout.cells == 8 ? " (TUM: t tx ty tz qx qy qz qw)" : ""));
  }
  StampedPose pose{.stamp = stamp_in(line, cells[layout.stamp], *layout.time_power),
                   .T_world_body = {}};
  for (std::size_t i = 0; i < 3; ++i) {
    pose.T_world_body.translation[static_cast<Eigen::Index>(i)] =
        layout.to_meters[i] * number_in(line, cells, layout.position[i]);
  }
  if (layout.has_rotation) pose.T_world_body.rotation = rotation_in(line, cells, layout);
  return pose;
}

bool is_header(std::string_view line) {
  if (line.starts_with('#') || line.starts_with('%')) return true;
  Cells cells;
  split_trajectory_line(line, cells);
  if (!cells.empty() && cells.front().empty()) cells.erase(cells.begin());  // pandas' row numbers
  const auto is_word = [](std::string_view cell) {
    return !cell.empty() && !text::parse_double(cell) && cell.find_first_of("0123456789") != 0 &&
           cell.front() != '-';
  };
  return cells.size() >= 4 && std::all_of(cells.begin(), cells.end(), is_word);
}

// Whether a time is one since 1970, from 1998 to 2112.
bool is_epoch(const std::string& stamp, int power) {
  const double seconds = text::parse_double(stamp).value_or(0.0) * std::pow(10.0, power - 9);
  return seconds >= 9e8 && seconds <= 4.5e9;
}

// Stamps without a stated unit tell it themselves, as do times since 1970 in another one.
void set_time_power(Content& content, const std::string& name) {
  TrajectoryLayout& layout = content.layout;
  std::vector<std::string> stamps;
  Cells cells;
  for (const Line& line : content.lines) {
    split_trajectory_line(line.text, cells);
    if (layout.stamp < cells.size()) stamps.push_back(with_decimal_point(cells[layout.stamp]));
  }
  const std::optional<int> stated = layout.time_power;
  const int power = guess_time_power(stamps, stated.value_or(layout.usual_time_power));
  if (stated) {
    const bool contradicts =
        !stamps.empty() && is_epoch(stamps.front(), power) && !is_epoch(stamps.front(), *stated);
    if (!contradicts) return;
    log::warning("{}: the header says {}, but {} is a time since 1970 in {}: taken as such", name,
                 name_of_power(*stated), stamps.front(), name_of_power(power));
  }
  layout.time_power = power;
}

// Lines that were mixed up are sorted by time.
void sort_lines(Content& content, const std::string& name) {
  const TrajectoryLayout& layout = content.layout;
  std::vector<TimedRow> rows;
  Cells cells;
  for (const Line& line : content.lines) {
    split_trajectory_line(line.text, cells);
    const auto number = layout.stamp < cells.size()
                            ? text::parse_double(with_decimal_point(cells[layout.stamp]))
                            : std::nullopt;
    rows.push_back({number.value_or(std::nan("")) * std::pow(10.0, *layout.time_power - 9),
                    std::hash<std::string>{}(line.text)});
  }
  const RowOrder order = order_by_time(rows);
  if (order.rows.empty()) return;
  std::vector<Line> sorted;
  for (const std::size_t row : order.rows) sorted.push_back(content.lines[row]);
  content.lines.swap(sorted);
  log::warning("{}: {} of {} lines are earlier than the line before; all are sorted by time", name,
               order.late, rows.size());
}

// A header must have a name for each number of the first line; else it is a remark.
bool fits(const TrajectoryLayout& layout, const Line& line) {
  Cells cells;
  split_trajectory_line(line.text, cells);
  return line.text.find_first_of(",;") != std::string::npos || cells.size() == layout.cells;
}

Content read_content(std::istream& in, const std::string& name) {
  Content content;
  std::optional<TrajectoryLayout> named;
  std::string buffer;
  std::size_t number = 0;
  while (std::getline(in, buffer)) {
    if (content.is_empty && buffer.find('\0') != std::string::npos) {
      fail_input("{}: this file is UTF-16 or no text; save it as UTF-8", name);
    }
    content.is_empty = false;
    Line line{std::string(text::trim(text::without_byte_order_mark(buffer))), name, ++number};
    if (line.text.empty()) continue;
    if (!is_header(line.text)) {
      content.lines.push_back(std::move(line));
    } else if (!named && content.lines.empty()) {
      named = layout_of_header(line.text, line.where());
    }
  }
  if (!content.lines.empty() && (!named || !fits(*named, content.lines.front()))) {
    named = layout_of_numbers(content.lines.front().text, content.lines.front().where());
  }
  if (named) content.layout = *named;
  set_time_power(content, name);
  sort_lines(content, name);
  return content;
}

// Stamps with too few digits are equal from line to line, although the poses change.
void check_digits(const Content& content) {
  std::size_t merged = 0;
  Cells before;
  Cells cells;
  const std::size_t stamp = content.layout.stamp;
  for (const Line& line : content.lines) {
    split_trajectory_line(line.text, cells);
    const bool complete = stamp < cells.size() && stamp < before.size();
    merged += complete && cells[stamp] == before[stamp] && cells != before ? 1 : 0;
    before = cells;
  }
  const std::size_t count = content.lines.size();
  if (count < kFewLines || 2 * merged < count) return;
  fail_input(
      "{}: {} of {} lines have the stamp of the line before, such as {}: the stamps lost "
      "digits; export them in full",
      content.lines.front().name, merged, count, before[stamp]);
}

// Latitude, longitude and altitude as meters east, north and up of the first fix.
class LocalFrame {
 public:
  Eigen::Vector3d meters(const Eigen::Vector3d& geodetic, const Line& line) {
    const GeodeticPosition fix{geodetic.x(), geodetic.y(), geodetic.z()};
    if (!is_fix(fix)) line.fail("latitude and longitude are no position in degrees");
    if (!origin_) origin_ = fix;
    return east_north_up(fix, *origin_);
  }

 private:
  std::optional<GeodeticPosition> origin_;
};

// The bad lines of a file that may have some.
struct BadLineCount {
  std::size_t count = 0;
  std::string first;  // message

  void add(const std::string& message) {
    if (count++ == 0) first = message;
  }
  void report(const std::string& name, std::size_t good) const {
    if (count == 0) return;
    if (good == 0) throw InputError(first);
    log::warning("{}: {} of {} lines dropped; the first: {}", name, count, count + good, first);
  }
};

}  // namespace

Trajectory parse_trajectory(std::istream& in, const std::string& name, BadLines bad_lines) {
  Trajectory trajectory;
  const Content content = read_content(in, name);
  if (content.is_empty) fail_input("{}: the file is empty", name);
  check_digits(content);
  Cells cells;
  BadLineCount bad;
  LocalFrame frame;
  for (const Line& line : content.lines) {
    try {
      StampedPose pose = pose_in(line, content.layout, cells);
      Eigen::Vector3d& position = pose.T_world_body.translation;
      if (content.layout.is_geodetic) position = frame.meters(position, line);
      if (!trajectory.empty() && pose.stamp <= trajectory.poses.back().stamp) {
        line.fail("the time does not increase; sort the lines and delete duplicates");
      }
      trajectory.poses.push_back(pose);
    } catch (const InputError& e) {
      if (bad_lines == BadLines::fail) throw;
      bad.add(e.what());
    }
  }
  bad.report(name, trajectory.size());
  trajectory.has_rotation = content.layout.has_rotation;
  const bool w_first = content.layout.xyzw[3] < content.layout.xyzw[0];
  if (!content.layout.has_names) check_quaternion_order(trajectory, w_first, name);
  // GNSS at the surface writes zeros for the height.
  const auto flat = [](const StampedPose& p) { return p.T_world_body.translation.z() == 0.0; };
  trajectory.has_height = trajectory.has_rotation ||
                          !std::all_of(trajectory.poses.begin(), trajectory.poses.end(), flat);
  return trajectory;
}

}  // namespace apvi::io
