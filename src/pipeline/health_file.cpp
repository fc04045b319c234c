// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/health_file.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>

#include "apvi/core/error.hpp"
#include "apvi/core/text.hpp"

namespace apvi::pipeline {
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

/// Cells of one line by the names in the file's header.
class Columns {
 public:
  Columns(const fs::path& file, std::string_view header) : file_(file.string()) {
    std::vector<std::string_view> cells;
    text::split(header, ',', cells);
    for (const std::string_view cell : cells) names_.emplace_back(bare_name(cell));
  }

  void take(std::string_view line) {
    text::split(line, ',', cells_);
    ++line_number_;
    if (cells_.size() < names_.size()) fail(names_.back(), "is missing; was the run cut short?");
  }
  std::string_view text(std::string_view name) const {
    const auto found = std::ranges::find(names_, name);
    if (found == names_.end()) fail(name, "no such column; is this a health.csv of `apvi run`?");
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

HealthLine line_of(const Columns& columns) {
  HealthLine line;
  line.stamp = Stamp{text::parse_int64(columns.text("timestamp")).value_or(0)};
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

std::vector<HealthLine> read_health(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string text;
  if (!in || !std::getline(in, text)) {
    fail_input("{}: cannot be read; a run with a camera writes it", file.string());
  }
  Columns columns(file, text);
  std::vector<HealthLine> lines;
  while (std::getline(in, text)) {
    if (text::trim(text).empty()) continue;
    columns.take(text);
    lines.push_back(line_of(columns));
  }
  return lines;
}

}  // namespace apvi::pipeline
