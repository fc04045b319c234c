// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/csv_file.hpp"

#include <algorithm>
#include <fstream>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

// Bounds memory for files without line breaks; no sensor row is longer.
constexpr std::size_t kMaxLineBytes = 64 * 1024;

std::string_view without_byte_order_mark(std::string_view line) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (line.starts_with(kMark)) line.remove_prefix(kMark.size());
  return line;
}

// Splits "#timestamp [ns]" into the column "timestamp" and the unit "ns".
std::pair<std::string, std::string> split_unit(std::string_view cell) {
  const std::size_t open = cell.find('[');
  std::string name = text::to_lower(text::trim(cell.substr(0, open)));
  if (open == std::string_view::npos) return {std::move(name), ""};
  std::string_view unit = cell.substr(open + 1);
  unit = unit.substr(0, unit.find(']'));
  return {std::move(name), std::string(text::trim(unit))};
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

void CsvFile::read_header() {
  bool found = false;
  while (!found && read_line()) found = !text::trim(without_byte_order_mark(line_)).empty();
  if (!found) fail_input("{}: the file is empty; expected a header line", name_);
  std::string_view header = text::trim(without_byte_order_mark(line_));
  if (header.starts_with('#')) header.remove_prefix(1);
  text::split(header, ',', cells_);
  if (text::parse_double(cells_.front())) {
    fail_input("{}:{}: expected a header line with column names, such as #timestamp [ns],…", name_,
               line_number_);
  }
  for (const std::string_view cell : cells_) {
    auto [column, unit] = split_unit(cell);
    columns_.push_back(std::move(column));
    units_.push_back(std::move(unit));
  }
  if (!units_.front().empty() && units_.front() != "ns" && units_.front() != "s") {
    fail_input("{}:{}: unknown time unit [{}]; use [ns] or [s]", name_, line_number_,
               units_.front());
  }
}

std::optional<std::size_t> CsvFile::find(std::initializer_list<std::string_view> names) const {
  for (const std::string_view name : names) {
    const auto it = std::find(columns_.begin(), columns_.end(), name);
    if (it != columns_.end()) return static_cast<std::size_t>(it - columns_.begin());
  }
  return std::nullopt;
}

std::size_t CsvFile::require_column(std::initializer_list<std::string_view> names) const {
  if (const auto column = find(names)) return *column;
  fail_input("{}: the header has no column \"{}\"; add it, or rename the one that holds it", name_,
             *names.begin());
}

bool CsvFile::next() {
  while (read_line()) {
    const std::string_view line = text::trim(line_);
    if (line.empty() || line.starts_with('#')) continue;
    text::split(line, ',', cells_);
    return true;
  }
  cells_.clear();
  return false;
}

std::string_view CsvFile::cell(std::size_t column) const {
  return column < cells_.size() ? cells_[column] : std::string_view{};
}

bool CsvFile::complete() const {
  if (too_long_ || cells_.size() < columns_.size()) return false;
  return std::all_of(cells_.begin() + static_cast<std::ptrdiff_t>(columns_.size()), cells_.end(),
                     [](std::string_view extra) { return extra.empty(); });
}

std::optional<std::int64_t> CsvFile::stamp_ns() const {
  const auto ns =
      units_.front() == "s" ? text::parse_seconds_as_ns(cell(0)) : text::parse_int64(cell(0));
  if (!ns || *ns < 0 || *ns > kMaxStampNs) return std::nullopt;
  return ns;
}

std::string CsvFile::where() const {
  return fmt::format("{}:{}", name_, line_number_);
}

double CsvFile::fraction() const {
  if (in_->eof()) return 1.0;
  return size_ == 0 ? 0.0
                    : std::min(1.0, static_cast<double>(bytes_read_) / static_cast<double>(size_));
}

}  // namespace apvi::io
