// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace apvi::io {

/// A file read at any position, with a small buffer for neighboring reads.
class BinaryFile {
 public:
  /// Throws InputError when the file cannot be opened.
  explicit BinaryFile(const std::filesystem::path& path);
  ~BinaryFile();
  BinaryFile(const BinaryFile&) = delete;
  BinaryFile& operator=(const BinaryFile&) = delete;

  const std::string& name() const { return name_; }
  std::uint64_t size() const { return size_; }
  /// Fills `bytes` from position `at`; false when the file ends before.
  bool read(std::uint64_t at, std::span<std::uint8_t> bytes);
  /// The `count` bytes at `at`, or those that exist. May be called by several threads.
  std::vector<std::uint8_t> read_block(std::uint64_t at, std::uint64_t count) const;

 private:
  std::size_t read_directly(std::uint64_t at, std::span<std::uint8_t> bytes) const;

  std::string name_;
  int handle_;
  std::uint64_t size_ = 0;
  std::uint64_t buffer_at_ = 0;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace apvi::io
