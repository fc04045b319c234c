// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// The cells of one line of CSV, in the dialects of spreadsheets and loggers.
namespace apvi::io {

/// The separator that a header uses: comma, semicolon, tab or bar; a comma when there is one
/// column.
char separator_of(std::string_view header);
/// Whether a line before the header is none: a comment, or Excel's "sep=;". A header that begins
/// with `#` has a column for the time.
bool is_remark(std::string_view line);
/// As text::split, but separators between quotes belong to the cell; quotes are removed.
void split_quoted(std::string_view line, char separator, std::vector<std::string_view>& cells);
/// "1,5" as "1.5", where commas do not separate cells.
std::string with_decimal_point(std::string_view cell);
/// The name of a column with underscores only: "gyro_x" for "gyro x", "angular_velocity_x" for
/// "angular_velocity.x" and for "field.angular_velocity.x", as rostopic writes it.
std::string plain_name(std::string_view column);
/// Splits "timestamp [ns]" into the lower-case column "timestamp" and the unit "ns"; parentheses
/// do as well.
std::pair<std::string, std::string> split_unit(std::string_view cell);
/// The units of a second header line such as "s,deg/s,[m/s^2],-", by cell, "" where there is none.
/// Empty when the line is no such line: at least half of its words must be known units, and none a
/// number.
std::vector<std::string> units_of_row(const std::vector<std::string_view>& cells);

}  // namespace apvi::io
