// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <istream>
#include <vector>

#include "importer/byte_reader.hpp"

namespace apvi::importer {

/// Reads a stream with a bounded look ahead, so that memory does not grow with a log.
class ByteWindow {
 public:
  explicit ByteWindow(std::istream& in) : in_(in) {}

  /// The next `count` bytes, or all that are left; they hold until the next call.
  Bytes ahead(std::size_t count) {
    if (buffer_.size() - at_ < count) refill(count);
    return Bytes(buffer_).subspan(at_, std::min(count, buffer_.size() - at_));
  }
  /// Passes over bytes that `ahead` has given.
  void skip(std::size_t count) { at_ += std::min(count, buffer_.size() - at_); }

 private:
  void refill(std::size_t count) {
    constexpr std::size_t kBlock = 1 << 18;
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(at_));
    at_ = 0;
    const std::size_t kept = buffer_.size();
    buffer_.resize(kept + std::max(kBlock, count));
    in_.read(reinterpret_cast<char*>(buffer_.data() + kept),
             static_cast<std::streamsize>(buffer_.size() - kept));
    buffer_.resize(kept + static_cast<std::size_t>(in_.gcount()));
  }

  std::istream& in_;
  std::vector<std::uint8_t> buffer_;
  std::size_t at_ = 0;
};

}  // namespace apvi::importer
