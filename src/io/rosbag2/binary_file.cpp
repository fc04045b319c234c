// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/binary_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

#include "apvi/core/error.hpp"

namespace apvi::io {
namespace {

constexpr std::size_t kBuffer = 64U << 10U;

}  // namespace

BinaryFile::BinaryFile(const std::filesystem::path& path)
    : name_(path.string()), handle_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (handle_ < 0) fail_input("{}: cannot open; check its permissions", name_);
  const off_t end = ::lseek(handle_, 0, SEEK_END);
  size_ = end > 0 ? static_cast<std::uint64_t>(end) : 0;
}

BinaryFile::~BinaryFile() {
  ::close(handle_);
}

std::size_t BinaryFile::read_directly(std::uint64_t at, std::span<std::uint8_t> bytes) const {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t count =
        ::pread(handle_, bytes.data() + done, bytes.size() - done, static_cast<off_t>(at + done));
    if (count <= 0) break;
    done += static_cast<std::size_t>(count);
  }
  return done;
}

bool BinaryFile::read(std::uint64_t at, std::span<std::uint8_t> bytes) {
  if (at > size_ || bytes.size() > size_ - at) return false;
  if (bytes.size() > kBuffer) return read_directly(at, bytes) == bytes.size();
  if (at < buffer_at_ || at + bytes.size() > buffer_at_ + buffer_.size()) {
    buffer_ = read_block(at, kBuffer);
    buffer_at_ = at;
  }
  if (bytes.size() > buffer_.size()) return false;  // the file shrank
  if (!bytes.empty()) std::memcpy(bytes.data(), buffer_.data() + (at - buffer_at_), bytes.size());
  return true;
}

std::vector<std::uint8_t> BinaryFile::read_block(std::uint64_t at, std::uint64_t count) const {
  const std::uint64_t available = at < size_ ? size_ - at : 0;
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(std::min(count, available)));
  bytes.resize(read_directly(at, bytes));
  return bytes;
}

}  // namespace apvi::io
