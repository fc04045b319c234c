// SPDX-License-Identifier: BSD-3-Clause
#include "importer/matroska.hpp"

#include <array>
#include <bit>
#include <cstdint>
#include <fstream>
#include <limits>

namespace apvi::importer {
namespace {

constexpr std::uint64_t kHeader = 0x1A45DFA3;
constexpr std::uint64_t kSegment = 0x18538067;
constexpr std::uint64_t kInfo = 0x1549A966;
constexpr std::uint64_t kCluster = 0x1F43B675;  // images: the Info is before them
constexpr std::uint64_t kDateUtc = 0x4461;
constexpr std::uint64_t kUnix2001_s = 978'307'200;
constexpr int kMaxElements = 1000;  // before the Info; more is a damaged file

struct Element {
  std::uint64_t id = 0;
  std::uint64_t size = 0;  // of its content [bytes]
};

std::optional<std::uint64_t> read_bytes(std::istream& in, int count, std::uint64_t value = 0) {
  for (int i = 0; i < count; ++i) {
    const int byte = in.get();
    if (byte < 0) return std::nullopt;
    value = value << 8U | static_cast<std::uint64_t>(byte);
  }
  return value;
}

// A number whose first byte tells its length by its leading zeros.
std::optional<std::uint64_t> read_number(std::istream& in, bool keep_marker) {
  const int first = in.get();
  if (first <= 0) return std::nullopt;
  const int more = std::countl_zero(static_cast<std::uint8_t>(first));
  const std::uint64_t marker = 0x80U >> static_cast<unsigned>(more);
  const auto begin = static_cast<std::uint64_t>(first);
  return read_bytes(in, more, keep_marker ? begin : begin & ~marker);
}

std::optional<Element> read_element(std::istream& in) {
  const auto id = read_number(in, /*keep_marker=*/true);
  const auto size = id ? read_number(in, /*keep_marker=*/false) : std::nullopt;
  if (!size) return std::nullopt;
  return Element{*id, *size};
}

// Goes to the content of the next such element; false if there is none.
bool go_to(std::istream& in, std::uint64_t id) {
  for (int i = 0; i < kMaxElements; ++i) {
    const auto element = read_element(in);
    if (!element || (element->id == kCluster && id != kCluster)) return false;
    if (element->id == id) return true;
    if (element->size > std::numeric_limits<std::uint32_t>::max()) return false;
    in.seekg(static_cast<std::streamoff>(element->size), std::ios::cur);
  }
  return false;
}

}  // namespace

std::optional<Stamp> matroska_date(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  const auto header = read_element(in);
  if (!header || header->id != kHeader || header->size > 4096) return std::nullopt;
  in.seekg(static_cast<std::streamoff>(header->size), std::ios::cur);
  if (!go_to(in, kSegment) || !go_to(in, kInfo) || !go_to(in, kDateUtc)) return std::nullopt;
  const auto since_2001_ns = read_bytes(in, 8);
  if (!since_2001_ns || *since_2001_ns == 0 || *since_2001_ns > 1ULL << 62U) return std::nullopt;
  return Stamp{static_cast<std::int64_t>(*since_2001_ns + kUnix2001_s * 1'000'000'000)};
}

}  // namespace apvi::importer
