// SPDX-License-Identifier: BSD-3-Clause
#include "runs/health_file.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 6> kEigenvalues{
    "rotation_eigenvalue_1", "rotation_eigenvalue_2", "rotation_eigenvalue_3",
    "position_eigenvalue_1", "position_eigenvalue_2", "position_eigenvalue_3"};

// "#timestamp [ns]" is the column "timestamp".
std::string_view bare_name(std::string_view cell) {
  if (cell.starts_with('#')) cell.remove_prefix(1);
  return text::trim(cell.substr(0, cell.find('[')));
}

/// Access to the cells of a line by column name.
class Columns {
 public:
  Columns(const fs::path& file, std::string_view header) : file_(file.string()) {
    std::vector<std::string_view> cells;
    text::split(header, ',', cells);
    for (const std::string_view cell : cells) names_.emplace_back(bare_name(cell));
  }

  void set_line(std::string_view line) {
    text::split(line, ',', cells_);
    ++line_number_;
    if (cells_.size() < names_.size()) fail(names_.back(), "missing; was the run interrupted?");
  }
  std::string_view text(std::string_view name) const {
    const auto found = std::ranges::find(names_, name);
    if (found == names_.end()) fail(name, "no such column; is this the health.csv of `apvi run`?");
    return cells_.at(static_cast<std::size_t>(found - names_.begin()));
  }
  double number(std::string_view name) const {
    const auto value = text::parse_double(text(name));
    if (!value) fail(name, "expected a number");
    return *value;
  }

 private:
  [[noreturn]] void fail(std::string_view name, std::string_view what) const {
    fail_input("{}:{}: {}: {}", file_, line_number_, name, what);
  }

  std::string file_;
  std::size_t line_number_ = 1;
  std::vector<std::string> names_;
  std::vector<std::string_view> cells_;
};

HealthRow to_row(const Columns& columns) {
  HealthRow line;
  line.stamp = Stamp{text::parse_int64(columns.text("timestamp")).value_or(0)};
  line.state = columns.text("state");
  line.level = columns.text("level");
  line.vio = columns.text("vio");
  line.landmarks = static_cast<int>(columns.number("landmarks"));
  for (std::size_t k = 0; k < 3; ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    line.eigenvalues.rotation(row) = columns.number(kEigenvalues.at(k));
    line.eigenvalues.position(row) = columns.number(kEigenvalues.at(k + 3));
  }
  return line;
}

}  // namespace

std::vector<HealthRow> read_health(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string text;
  if (!in || !std::getline(in, text)) {
    fail_input("{}: cannot be read; only runs with a camera write it", file.string());
  }
  Columns columns(file, text);
  std::vector<HealthRow> lines;
  while (std::getline(in, text)) {
    if (text::trim(text).empty()) continue;
    columns.set_line(text);
    lines.push_back(to_row(columns));
  }
  return lines;
}

}  // namespace apvi::runs
