// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/ply_table.hpp"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/text.hpp"

namespace apvi::map_io {
namespace {

constexpr std::int64_t kRowsPerBatch = 4096;

template <typename T>
double load(const unsigned char* bytes, bool swap) {
  unsigned char own[sizeof(T)];
  std::memcpy(own, bytes, sizeof(T));
  if (swap) std::reverse(own, own + sizeof(T));
  T value;
  std::memcpy(&value, own, sizeof(T));
  return static_cast<double>(value);
}

double load(const unsigned char* bytes, PlyType type, bool swap) {
  switch (type) {
    case PlyType::int8:
      return load<std::int8_t>(bytes, swap);
    case PlyType::uint8:
      return load<std::uint8_t>(bytes, swap);
    case PlyType::int16:
      return load<std::int16_t>(bytes, swap);
    case PlyType::uint16:
      return load<std::uint16_t>(bytes, swap);
    case PlyType::int32:
      return load<std::int32_t>(bytes, swap);
    case PlyType::uint32:
      return load<std::uint32_t>(bytes, swap);
    case PlyType::float32:
      return load<float>(bytes, swap);
    case PlyType::float64:
      break;
  }
  return load<double>(bytes, swap);
}

void store(const PlyColumn& column, std::int64_t row, double value) {
  if (column.exact != nullptr) {
    column.exact[row * column.stride] = value - column.offset;
  } else {
    column.to[row * column.stride] = static_cast<float>(value - column.offset);
  }
}

std::unique_ptr<std::istream> open_file(const std::filesystem::path& path) {
  if (std::filesystem::is_directory(path))
    fail_input("{}: this is a folder, not a PLY file", path.string());
  auto in = std::make_unique<std::ifstream>(path, std::ios::binary);
  if (!*in) fail_input("{}: cannot be read; does the file exist?", path.string());
  return in;
}

}  // namespace

PlyTable::PlyTable(const std::filesystem::path& path, std::string_view element)
    : PlyTable(open_file(path), path.string(), element) {}

PlyTable::PlyTable(std::unique_ptr<std::istream> in, std::string name, std::string_view element)
    : name_(std::move(name)), in_(std::move(in)) {
  header_ = read_ply_header(*in_, name_);
  open(element);
}

// Advances to the first row of the element.
void PlyTable::open(std::string_view element) {
  for (const PlyElement& next : header_.elements) {
    if (next.name == element) {
      element_ = next;
      if (element_.has_list) fail_input("{}: element {}: lists are not supported", name_, element);
      return check_size(element_);
    }
    skip(next);
  }
  fail_input("{}:{}: the header has no element {}", name_, header_.lines, element);
}

void PlyTable::skip(const PlyElement& element) {
  if (header_.encoding == PlyEncoding::ascii) {
    for (std::int64_t i = 0; i < element.rows && *in_; ++i) {
      in_->ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    }
  } else {
    if (element.has_list) {
      fail_input("{}: element {} has lists and precedes the vertices, which is not supported",
                 name_, element.name);
    }
    check_size(element);
    in_->seekg(element.rows * element.row_bytes(), std::ios::cur);
  }
}

void PlyTable::check_size(const PlyElement& element) {
  const std::streamoff begin = in_->tellg();
  in_->seekg(0, std::ios::end);
  const std::int64_t available = in_->tellg() - begin;
  in_->seekg(begin);
  const auto columns = static_cast<std::int64_t>(element.properties.size());
  // A number in text takes at least a digit and a separator; the last line may lack its line break.
  const bool ascii = header_.encoding == PlyEncoding::ascii;
  const std::int64_t min_bytes = ascii ? 2 * columns : element.row_bytes();
  if (!*in_ || columns == 0 || element.rows * min_bytes > available + (ascii ? 1 : 0)) {
    fail_input(
        "{}: the header states {} rows of element {} of {} bytes each, but {} bytes follow: the "
        "file is truncated or corrupt",
        name_, element.rows, element.name, min_bytes, *in_ ? available : 0);
  }
}

std::size_t PlyTable::require_property(std::string_view property) const {
  const auto found = find(property);
  if (!found) {
    fail_input("{}:{}: element {} has no property {}", name_, header_.lines, element_.name,
               property);
  }
  return *found;
}

void PlyTable::read(const std::vector<PlyColumn>& columns) {
  if (header_.encoding == PlyEncoding::ascii) {
    read_ascii(columns);
  } else {
    read_binary(columns);
  }
}

void PlyTable::read_ascii(const std::vector<PlyColumn>& columns) {
  const std::size_t width = element_.properties.size();
  std::vector<double> row(width);
  std::string word;
  for (std::int64_t i = 0; i < element_.rows; ++i) {
    for (double& value : row) {
      if (!(*in_ >> word)) fail_input("{}: the file ends at {} {}", name_, element_.name, i);
      const auto number = text::parse_double(word);
      if (!number)
        fail_input("{}: {} {}: \"{:.40}\" is not a number", name_, element_.name, i, word);
      value = *number;
    }
    for (const PlyColumn& column : columns) store(column, i, row[column.property]);
  }
}

void PlyTable::read_binary(const std::vector<PlyColumn>& columns) {
  const std::int64_t row_bytes = element_.row_bytes();
  std::vector<std::int64_t> offsets;
  std::int64_t offset = 0;
  for (const PlyProperty& property : element_.properties) {
    offsets.push_back(offset);
    offset += size_of(property.type);
  }
  const bool swap =
      header_.encoding == PlyEncoding::big_endian;  // the host is assumed little-endian
  std::vector<unsigned char> bytes;
  for (std::int64_t begin = 0; begin < element_.rows; begin += kRowsPerBatch) {
    const std::int64_t rows = std::min(kRowsPerBatch, element_.rows - begin);
    bytes.resize(static_cast<std::size_t>(rows * row_bytes));
    in_->read(reinterpret_cast<char*>(bytes.data()), rows * row_bytes);
    if (!*in_) fail_input("{}: the file ends near {} {}", name_, element_.name, begin);
    for (const PlyColumn& column : columns) {
      const PlyType type = element_.properties[column.property].type;
      const unsigned char* from = bytes.data() + offsets[column.property];
      for (std::int64_t i = 0; i < rows; ++i) {
        store(column, begin + i, load(from + i * row_bytes, type, swap));
      }
    }
  }
}

}  // namespace apvi::map_io
