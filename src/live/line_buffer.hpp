// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace apvi::live {

/// Cuts a stream of bytes into lines.
class LineBuffer {
 public:
  static constexpr std::size_t kMaxLine = std::size_t{64} * 1024;

  /// False when the line that has begun is too long; it is discarded up to here.
  bool append(std::string_view bytes) {
    text_ += bytes;
    if (text_.size() - begin_ <= kMaxLine || text_.find('\n', begin_) != std::string::npos) {
      return true;
    }
    text_.clear();
    begin_ = 0;
    return false;
  }

  /// The next complete line without its break; valid until the next call.
  std::optional<std::string_view> next() {
    const std::size_t end = text_.find('\n', begin_);
    if (end == std::string::npos) {
      text_.erase(0, begin_);
      begin_ = 0;
      return std::nullopt;
    }
    const std::string_view line = std::string_view(text_).substr(begin_, end - begin_);
    begin_ = end + 1;
    return line;
  }

 private:
  std::string text_;
  std::size_t begin_ = 0;
};

}  // namespace apvi::live
