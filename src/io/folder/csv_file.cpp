// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/csv_file.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <limits>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/csv_cells.hpp"
#include "io/folder/time_column.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

// Bounds memory for files without line breaks; no sensor row is longer.
constexpr std::size_t kMaxLineBytes = std::size_t{64} * 1024;

// For messages: the beginning, without what a terminal or a log cannot show.
std::string shown(std::string_view text) {
  constexpr std::size_t kMaxShown = 80;
  std::string words(text.substr(0, kMaxShown));
  std::replace_if(
      words.begin(), words.end(), [](unsigned char c) { return c < ' '; }, '?');
  return words;
}

}  // namespace

std::unique_ptr<std::istream> open_text(const fs::path& path) {
  if (fs::is_directory(path)) fail_input("{}: this is a folder, not a file", path.string());
  auto in = std::make_unique<std::ifstream>(path, std::ios::binary);
  if (!*in) {
    fail_input("{}: {}", path.string(),
               fs::exists(path) ? "cannot open; check its permissions" : "no such file");
  }
  return in;
}

CsvFile::CsvFile(const fs::path& path) : CsvFile(open_text(path), path.string()) {
  std::error_code unknown;  // a pipe has no size, so progress is unknown
  const auto size = fs::file_size(path, unknown);
  size_ = unknown ? 0 : size;
}

CsvFile::CsvFile(std::unique_ptr<std::istream> in, std::string name)
    : in_(std::move(in)), name_(std::move(name)), buffer_(kMaxLineBytes) {
  read_header();
}

bool CsvFile::read_line() {
  row_begin_ = bytes_read_;
  in_->getline(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
  const auto count = static_cast<std::size_t>(in_->gcount());
  too_long_ = in_->fail() && count == buffer_.size() - 1;
  if (in_->fail() && !too_long_) return false;
  bytes_read_ += count;
  ++line_number_;
  // gcount includes the line break, except at the end of the file.
  line_ = std::string_view(buffer_.data(), too_long_ || in_->eof() ? count : count - 1);
  if (too_long_) {
    in_->clear();
    in_->ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    bytes_read_ += static_cast<std::uint64_t>(in_->gcount());
  }
  return true;
}

// UTF-16 has a mark or a zero byte in every other place. Files that a power failure cut short hold
// zero bytes only.
void CsvFile::check_encoding() const {
  const bool zero = line_.find('\0') != std::string_view::npos;
  if (line_.size() > 1 && line_[0] == 0 && line_[1] == 0) {
    fail_input("{}:{}: zero bytes instead of a header line: the recording was not written", name_,
               line_number_);
  }
  if (zero || line_.starts_with("\xFF\xFE") || line_.starts_with("\xFE\xFF")) {
    fail_input("{}: this file is UTF-16; save it as UTF-8", name_);
  }
  if (text::trim(line_).find('\r') == std::string_view::npos) return;
  fail_input("{}: the lines end in CR only; save it with LF or CRLF line breaks", name_);
}

std::string_view CsvFile::find_header() {
  std::string_view header;
  do {
    if (!read_line()) fail_input("{}: the file is empty; expected a header line", name_);
    check_encoding();
    header = text::trim(text::without_byte_order_mark(line_));
  } while (header.empty() || is_remark(header));
  if (header.starts_with('#')) header.remove_prefix(1);
  return header;
}

void CsvFile::read_header() {
  const std::string_view header = find_header();
  separator_ = separator_of(header);
  split_cells(header);
  if (text::parse_double(with_decimal_point(cells_.front()))) {
    fail_input("{}:{}: expected a header line with column names, such as #timestamp [ns],…", name_,
               line_number_);
  }
  while (cells_.size() > 1 && cells_.back().empty()) cells_.pop_back();
  for (std::string_view cell : cells_) {
    if (cell.starts_with('#')) cell.remove_prefix(1);  // within quotes
    auto [column, unit] = split_unit(cell);
    columns_.push_back(std::move(column));
    units_.push_back(std::move(unit));
  }
  if (columns_.size() == 1) fail_for_one_column();
  read_unit_row();
  time_column_ = find_time_column(columns_, units_);
  read_time_unit();
  check_stamps();
  find_order();
}

// Some loggers write the units below the names, which then have none of their own.
void CsvFile::read_unit_row() {
  const auto place = in_->tellg();
  if (place == std::istream::pos_type(-1)) return;
  const std::size_t line_number = line_number_;
  const std::uint64_t bytes = bytes_read_;
  std::vector<std::string> units;
  if (read_line()) {
    split_cells(text::trim(line_));
    units = units_of_row(cells_);
  }
  if (units.empty()) {
    in_->clear();
    in_->seekg(place);
    line_number_ = line_number;
    bytes_read_ = bytes;
    return;
  }
  for (std::size_t i = 0; i < std::min(units.size(), units_.size()); ++i) {
    if (units_[i].empty()) units_[i] = std::move(units[i]);
  }
}

std::optional<std::size_t> CsvFile::find(std::initializer_list<std::string_view> names) const {
  for (const std::string_view name : names) {
    const auto it = std::find(columns_.begin(), columns_.end(), name);
    if (it != columns_.end()) return static_cast<std::size_t>(it - columns_.begin());
  }
  for (const std::string_view name : names) {
    const auto is_named = [&](const std::string& column) { return plain_name(column) == name; };
    const auto it = std::find_if(columns_.begin(), columns_.end(), is_named);
    if (it != columns_.end()) return static_cast<std::size_t>(it - columns_.begin());
  }
  return std::nullopt;
}

void CsvFile::fail_for_one_column() const {
  fail_input("{}:{}: one column only; separate them by commas, semicolons or tabs", name_,
             line_number_);
}

std::size_t CsvFile::require_column(std::initializer_list<std::string_view> names) const {
  if (const auto column = find(names)) return *column;
  const std::string list = fmt::format("{}", fmt::join(columns_, ", "));
  fail_input(
      "{}: the header has no column \"{}\"; add it, or rename the one that holds it; there are "
      "{}{}",
      name_, *names.begin(), shown(list), shown(list) == list ? "" : "…");
}

void CsvFile::split_cells(std::string_view line) {
  if (line.find('"') == std::string_view::npos) {
    text::split(line, separator_, cells_);
  } else {
    split_quoted(line, separator_, cells_);
  }
}

bool CsvFile::next() {
  refused_.reset();
  while (seek_next_row() && read_line()) {
    const std::string_view line = text::trim(line_);
    if (line.empty() || line.starts_with('#')) continue;
    // A tab at the end separates too: only the line break is cut.
    split_cells(separator_ == '\t' ? line_ : line);
    if (is_header_again()) continue;
    return true;
  }
  cells_.clear();
  return false;
}

// Files that were put together have a header within. Its columns must be those of the first one.
bool CsvFile::is_header_again() const {
  if (cells_.size() < 2 || columns_.empty() || cells_.size() < columns_.size()) return false;
  if (line_.find_first_of("0123456789-.") == 0) return false;
  const auto name = [&](std::size_t i) { return split_unit(cells_[i]).first; };
  const std::size_t count = columns_.size();
  std::size_t known = 0;
  std::size_t same = 0;
  for (std::size_t i = 0; i < count; ++i) {
    known += std::find(columns_.begin(), columns_.end(), name(i)) != columns_.end() ? 1 : 0;
    same += name(i) == columns_[i] && split_unit(cells_[i]).second == units_[i] ? 1 : 0;
  }
  if (same == count) return true;
  if (known < count) return false;
  fail_input(
      "{}: another header, with columns in another order or unit than the first one: put the rows "
      "below it into a file of their own, or write them as those above",
      where());
}

std::string_view CsvFile::cell(std::size_t column) const {
  return column < cells_.size() ? cells_[column] : std::string_view{};
}

bool CsvFile::complete() const {
  if (too_long_ || cells_.size() < columns_.size()) return false;
  return std::all_of(cells_.begin() + static_cast<std::ptrdiff_t>(columns_.size()), cells_.end(),
                     [](std::string_view extra) { return extra.empty(); });
}

std::optional<RowProblem> CsvFile::problem() const {
  const std::string line = shown(text::trim(line_));
  if (too_long_) return RowProblem{"the line is too long", line};
  if (!stamp_ns()) {
    const std::string place =
        time_column_ == 0 ? "the first column" : "column " + columns_[time_column_];
    return RowProblem{"no stamp in " + place, shown(cell(time_column_))};
  }
  if (cells_.size() < columns_.size()) return RowProblem{"too few cells", line};
  if (!complete()) return RowProblem{"more cells than the header", line};
  return std::nullopt;
}

bool CsvFile::look_ahead(const std::function<bool()>& visit) {
  if (is_at_end()) return true;
  const std::string present(line_);
  const auto place = in_->tellg();
  if (place == std::istream::pos_type(-1) && order_.empty()) {
    in_->clear();
    return false;
  }
  const std::size_t line_number = line_number_;
  const std::uint64_t bytes = bytes_read_;
  const std::size_t row = next_row_;
  while (next() && visit()) {
  }
  in_->clear();
  if (place != std::istream::pos_type(-1)) in_->seekg(place);
  line_number_ = line_number;
  bytes_read_ = bytes;
  next_row_ = row;
  too_long_ = false;
  std::copy(present.begin(), present.end(), buffer_.begin());
  line_ = std::string_view(buffer_.data(), present.size());
  cells_.clear();
  return true;
}

std::string CsvFile::where() const {
  return fmt::format("{}:{}", name_, line_number_);
}

double CsvFile::fraction() const {
  if (is_at_end()) return 1.0;
  if (!order_.empty()) return static_cast<double>(next_row_) / static_cast<double>(order_.size());
  return size_ == 0 ? 0.0
                    : std::min(1.0, static_cast<double>(bytes_read_) / static_cast<double>(size_));
}

}  // namespace apvi::io
