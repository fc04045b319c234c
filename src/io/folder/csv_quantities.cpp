// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/csv_cells.hpp"
#include "io/folder/csv_file.hpp"

// The numbers of a CSV file and their units.
namespace apvi::io {

// The unit that is appended to one of the names, as in "depth_cm".
const Unit* CsvFile::unit_in_name(std::size_t column, Names names, Dimension dimension) const {
  for (const std::string_view name : names) {
    const std::string plain = plain_name(columns_[column]);
    std::string_view rest = plain;
    if (!rest.starts_with(name)) continue;
    rest.remove_prefix(name.size());
    if (!rest.starts_with('_')) continue;
    std::string word(rest.substr(1));
    if (const Unit* unit = find_unit(dimension, word)) return unit;
    std::replace(word.begin(), word.end(), '_', '/');  // "v_x_mm_s"
    if (const Unit* unit = find_unit(dimension, word)) return unit;
  }
  return nullptr;
}

std::optional<Quantity> CsvFile::find_quantity(Names names, Dimension dimension) const {
  if (const auto column = find(names)) {
    const std::string& word = units_[*column];
    if (word.empty()) return Quantity{*column, 1.0, false};
    if (const Unit* unit = find_unit(dimension, word)) return Quantity{*column, unit->to_si, true};
    fail_input("{}: column {}: unknown unit [{}]; known here: {}", name_, columns_[*column], word,
               known_units(dimension));
  }
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (const Unit* unit = unit_in_name(i, names, dimension)) return Quantity{i, unit->to_si, true};
  }
  return std::nullopt;
}

Quantity CsvFile::require_quantity(Names names, Dimension dimension) const {
  if (const auto quantity = find_quantity(names, dimension)) return *quantity;
  return {require_column(names), 1.0, false};
}

std::optional<double> CsvFile::number(std::size_t column) const {
  const std::string_view word = cell(column);
  const bool comma = separator_ != ',' && word.find(',') != std::string_view::npos;
  const auto value = text::parse_double(comma ? with_decimal_point(word) : word);
  if (!value) refuse(column, "is not a number");
  return value;
}

void CsvFile::refuse(std::size_t column, std::string_view why) const {
  refused_ = Refused{column, why};
}

std::optional<RowProblem> CsvFile::cell_problem() const {
  if (!refused_) return std::nullopt;
  return RowProblem{fmt::format("column {} {}", columns_[refused_->column], refused_->why),
                    std::string(cell(refused_->column))};
}

std::optional<double> CsvFile::number(const Quantity& quantity) const {
  const auto value = number(quantity.column);
  return value ? std::optional<double>(*value * quantity.to_si) : std::nullopt;
}

}  // namespace apvi::io
