// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/csv_cells.hpp"

#include <algorithm>
#include <cstddef>

#include "core/text.hpp"
#include "io/folder/time_column.hpp"
#include "io/folder/units.hpp"

namespace apvi::io {
namespace {

std::string_view without_quotes(std::string_view cell) {
  if (cell.size() < 2 || cell.front() != '"' || cell.back() != '"') return cell;
  return text::trim(cell.substr(1, cell.size() - 2));
}

}  // namespace

char separator_of(std::string_view header) {
  char best = ',';
  std::ptrdiff_t most = std::count(header.begin(), header.end(), ',');
  for (const char c : {';', '\t', '|'}) {
    const std::ptrdiff_t count = std::count(header.begin(), header.end(), c);
    if (count > most) best = c;
    most = std::max(most, count);
  }
  return best;
}

bool is_remark(std::string_view line) {
  if (text::to_lower(line).starts_with("sep=")) return true;  // for Excel
  if (!line.starts_with('#')) return false;
  line.remove_prefix(1);
  std::vector<std::string_view> cells;
  split_quoted(line, separator_of(line), cells);
  return cells.size() < 2 || std::none_of(cells.begin(), cells.end(), [](std::string_view cell) {
           const auto [name, unit] = split_unit(cell);
           const bool one_word = name.find(' ') == std::string::npos;
           return (one_word && may_be_time(name)) || is_time_name(name, !unit.empty());
         });
}

void split_quoted(std::string_view line, char separator, std::vector<std::string_view>& cells) {
  cells.clear();
  std::size_t begin = 0;
  bool quoted = false;
  for (std::size_t i = 0; i <= line.size(); ++i) {
    if (i < line.size() && line[i] == '"') quoted = !quoted;
    if (i < line.size() && (quoted || line[i] != separator)) continue;
    cells.push_back(without_quotes(text::trim(line.substr(begin, i - begin))));
    begin = i + 1;
  }
}

std::string with_decimal_point(std::string_view cell) {
  std::string number(cell);
  std::replace(number.begin(), number.end(), ',', '.');
  return number;
}

std::string plain_name(std::string_view column) {
  std::string name(column);
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == ' ' || c == '.' || c == '/'; }, '_');
  constexpr std::string_view kMessage = "field_";
  return name.starts_with(kMessage) ? name.substr(kMessage.size()) : name;
}

std::pair<std::string, std::string> split_unit(std::string_view cell) {
  const std::size_t open = cell.find_first_of("[(");
  std::string name = text::to_lower(text::trim(cell.substr(0, open)));
  if (open == std::string_view::npos) return {std::move(name), ""};
  std::string_view unit = cell.substr(open + 1);
  unit = unit.substr(0, unit.find_last_of("])"));
  return {std::move(name), std::string(text::trim(unit))};
}

std::vector<std::string> units_of_row(const std::vector<std::string_view>& cells) {
  std::vector<std::string> units;
  std::size_t words = 0;
  std::size_t known = 0;
  for (std::string_view cell : cells) {
    if (cell.starts_with('#')) cell.remove_prefix(1);
    const auto [name, bracketed] = split_unit(cell);
    std::string unit = name.empty() ? bracketed : std::string(text::trim(cell));
    const std::string word = text::to_lower(unit);
    if (word == "-" || word == "1" || word == "none") unit.clear();
    if (text::parse_double(with_decimal_point(unit))) return {};
    words += unit.empty() ? 0 : 1;
    known += find_unit(unit) != nullptr ? 1 : 0;
    units.push_back(std::move(unit));
  }
  if (known == 0 || 2 * known < words) units.clear();
  return units;
}

}  // namespace apvi::io
