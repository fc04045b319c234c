// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/text.hpp"
#include "io/folder/csv_file.hpp"
#include "io/folder/row_order.hpp"

// Rows of a CSV file that are not in order of time.
namespace apvi::io {

std::optional<double> CsvFile::time_number() const {
  return text::parse_double(time_text());
}

bool CsvFile::is_in_order() {
  bool in_order = true;
  double latest = -std::numeric_limits<double>::infinity();
  look_ahead([&] {
    const double time = time_number().value_or(latest);
    in_order = !(time < latest);
    latest = time;
    return in_order;
  });
  return in_order;
}

void CsvFile::find_order() {
  if (is_in_order()) return;
  const double to_seconds = std::pow(10.0, time_power_ - 9);
  std::vector<TimedRow> rows;
  std::vector<RowPlace> places;
  look_ahead([&] {
    const double time = time_number().value_or(std::numeric_limits<double>::quiet_NaN());
    rows.push_back({to_seconds * time, std::hash<std::string_view>{}(text::trim(line_))});
    places.push_back({row_begin_, line_number_});
    return true;
  });
  const RowOrder order = order_by_time(rows);
  for (const std::size_t row : order.rows) order_.push_back(places[row]);
  if (order_.empty()) return;
  order_remark_ =
      fmt::format("{}: {} of {} rows are earlier than the row before; all are sorted by time",
                  name_, order.late, rows.size());
}

bool CsvFile::is_at_end() const {
  return order_.empty() ? in_->eof() : next_row_ == order_.size();
}

// Goes to the next row by time; false when there is none. In a file that is in order nothing needs
// to be done.
bool CsvFile::seek_next_row() {
  if (order_.empty()) return true;
  if (next_row_ == order_.size()) return false;
  const RowPlace& row = order_[next_row_++];
  if (row.begin != bytes_read_ || !in_->good()) {
    in_->clear();
    in_->seekg(static_cast<std::streamoff>(row.begin));
  }
  bytes_read_ = row.begin;
  line_number_ = row.line_number - 1;
  return true;
}

}  // namespace apvi::io
