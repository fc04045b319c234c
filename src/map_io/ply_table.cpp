// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/ply_table.hpp"

#include <algorithm>
#include <cstring>
#include <system_error>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "map_io/ply_header.hpp"

namespace apvi::map_io {
namespace {

constexpr std::int64_t kRowsPerBatch = 4096;

template <typename T>
float load(const unsigned char* bytes, bool swap) {
  unsigned char own[sizeof(T)];
  std::memcpy(own, bytes, sizeof(T));
  if (swap) std::reverse(own, own + sizeof(T));
  T value;
  std::memcpy(&value, own, sizeof(T));
  return static_cast<float>(value);
}

float load(const unsigned char* bytes, PlyType type, bool swap) {
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

}  // namespace

PlyTable::PlyTable(const std::filesystem::path& path) : name_(path.string()) {
  if (std::filesystem::is_directory(path))
    fail_input("{}: this is a folder, not a PLY file", name_);
  in_.open(path, std::ios::binary);
  if (!in_) fail_input("{}: cannot be read; does the file exist?", name_);
  header_ = read_ply_header(in_, name_);
  for (const PlyProperty& property : header_.properties) row_bytes_ += size_of(property.type);
  check_size();
}

void PlyTable::check_size() {
  const std::streamoff begin = in_.tellg();
  in_.seekg(0, std::ios::end);
  const std::int64_t available = in_.tellg() - begin;
  in_.seekg(begin);
  const auto columns = static_cast<std::int64_t>(header_.properties.size());
  // A number in text takes at least a digit and a separator; the last line may lack its line break.
  const bool ascii = header_.encoding == PlyEncoding::ascii;
  const std::int64_t min_bytes = ascii ? 2 * columns : row_bytes_;
  if (!in_ || columns == 0 || header_.vertices * min_bytes > available + (ascii ? 1 : 0)) {
    fail_input(
        "{}: the header states {} vertices of {} bytes each, but {} bytes follow: the file is "
        "truncated or corrupt",
        name_, header_.vertices, min_bytes, available);
  }
}

std::optional<std::size_t> PlyTable::find(std::string_view name) const {
  for (std::size_t i = 0; i < header_.properties.size(); ++i) {
    if (header_.properties[i].name == name) return i;
  }
  return std::nullopt;
}

std::size_t PlyTable::require_property(std::string_view name) const {
  const auto found = find(name);
  if (!found) fail_input("{}:{}: the vertices have no property {}", name_, header_.lines, name);
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
  const std::size_t width = header_.properties.size();
  std::vector<float> row(width);
  std::string word;
  for (std::int64_t i = 0; i < header_.vertices; ++i) {
    for (float& value : row) {
      if (!(in_ >> word)) fail_input("{}: the file ends at vertex {}", name_, i);
      const auto number = text::parse_double(word);
      if (!number) fail_input("{}: vertex {}: \"{:.40}\" is not a number", name_, i, word);
      value = static_cast<float>(*number);
    }
    for (const PlyColumn& column : columns) column.to[i * column.stride] = row[column.property];
  }
}

void PlyTable::read_binary(const std::vector<PlyColumn>& columns) {
  std::vector<std::int64_t> offsets;
  std::int64_t offset = 0;
  for (const PlyProperty& property : header_.properties) {
    offsets.push_back(offset);
    offset += size_of(property.type);
  }
  const bool swap =
      header_.encoding == PlyEncoding::big_endian;  // the host is assumed little-endian
  std::vector<unsigned char> bytes;
  for (std::int64_t begin = 0; begin < header_.vertices; begin += kRowsPerBatch) {
    const std::int64_t rows = std::min(kRowsPerBatch, header_.vertices - begin);
    bytes.resize(static_cast<std::size_t>(rows * row_bytes_));
    in_.read(reinterpret_cast<char*>(bytes.data()), rows * row_bytes_);
    if (!in_) fail_input("{}: the file ends near vertex {}", name_, begin);
    for (const PlyColumn& column : columns) {
      const PlyType type = header_.properties[column.property].type;
      const unsigned char* from = bytes.data() + offsets[column.property];
      for (std::int64_t i = 0; i < rows; ++i) {
        column.to[(begin + i) * column.stride] = load(from + i * row_bytes_, type, swap);
      }
    }
  }
}

}  // namespace apvi::map_io
