// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace apvi::importer {

using Bytes = std::span<const std::uint8_t>;

enum class ByteOrder { big, little };

/// Reads numbers from bytes. A read past the end yields zero and makes `ok` false for good, so that
/// a parser may check once after several reads.
class ByteReader {
 public:
  explicit ByteReader(Bytes bytes, ByteOrder order = ByteOrder::big)
      : bytes_(bytes), order_(order) {}

  bool ok() const { return ok_; }
  std::size_t left() const { return bytes_.size() - at_; }
  std::size_t position() const { return at_; }

  std::uint8_t u8() { return static_cast<std::uint8_t>(number(1)); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(number(2)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(number(4)); }
  std::uint64_t u64() { return number(8); }
  std::int32_t i32() { return static_cast<std::int32_t>(u32()); }
  std::int64_t i64() { return static_cast<std::int64_t>(u64()); }
  float f32() { return std::bit_cast<float>(u32()); }
  double f64() { return std::bit_cast<double>(u64()); }

  /// The next `count` bytes; empty past the end.
  Bytes take(std::size_t count) {
    if (count > left()) {
      fail();
      return {};
    }
    at_ += count;
    return bytes_.subspan(at_ - count, count);
  }
  void skip(std::size_t count) { take(count); }
  std::string text(std::size_t count) {
    const Bytes part = take(count);
    return {part.begin(), part.end()};
  }
  std::string fourcc() { return text(4); }

 private:
  void fail() {
    ok_ = false;
    at_ = bytes_.size();
  }
  std::uint64_t number(std::size_t count) {
    const Bytes part = take(count);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < part.size(); ++i) {
      value = value << 8 | part[order_ == ByteOrder::big ? i : part.size() - 1 - i];
    }
    return value;
  }

  Bytes bytes_;
  ByteOrder order_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

}  // namespace apvi::importer
