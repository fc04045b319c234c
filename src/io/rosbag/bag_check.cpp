// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/bag_check.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"

// http://wiki.ros.org/Bags/Format/2.0: a version line, then records, each with a header of named
// values and a data block, both length-prefixed.
namespace apvi::io {
namespace {

constexpr std::string_view kMagic = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxHeader = 1U << 20U;
enum Op : std::uint8_t { kIndex = 4, kChunk = 5, kChunkInfo = 6 };

class File {
 public:
  explicit File(const std::filesystem::path& path)
      : name_(path.string()), handle_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (handle_ < 0) fail_input("{}: cannot open; check its permissions", name_);
    const off_t end = ::lseek(handle_, 0, SEEK_END);
    size_ = end > 0 ? static_cast<std::uint64_t>(end) : 0;
  }
  ~File() { ::close(handle_); }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  std::uint64_t size() const { return size_; }
  void read(std::uint64_t at, void* bytes, std::size_t count) const {
    if (at > size_ || count > size_ - at ||
        ::pread(handle_, bytes, count, static_cast<off_t>(at)) != static_cast<ssize_t>(count)) {
      fail(at);
    }
  }
  std::uint32_t length(std::uint64_t at) const {
    std::uint32_t value = 0;
    read(at, &value, sizeof(value));
    return value;
  }
  [[noreturn]] void fail(std::uint64_t at) const {
    fail_input("{}: the bag is damaged at byte {}, or truncated; run \"rosbag reindex\"", name_,
               at);
  }

 private:
  std::string name_;
  int handle_;
  std::uint64_t size_ = 0;
};

// Value of a numeric field in a record's header.
template <typename T>
std::optional<T> field(std::string_view header, std::string_view name) {
  while (header.size() >= 4) {
    std::uint32_t length = 0;
    std::memcpy(&length, header.data(), 4);
    header.remove_prefix(4);
    if (length > header.size()) return std::nullopt;
    const std::string_view entry = header.substr(0, length);
    header.remove_prefix(length);
    const std::size_t equals = entry.find('=');
    if (equals == std::string_view::npos || entry.substr(0, equals) != name) continue;
    if (entry.size() - equals - 1 != sizeof(T)) return std::nullopt;
    T value{};
    std::memcpy(&value, entry.data() + equals + 1, sizeof(T));
    return value;
  }
  return std::nullopt;
}

struct Record {
  std::string header;
  std::uint64_t data = 0;  // offset of its data
  std::uint32_t data_size = 0;
  std::uint64_t end() const { return data + data_size; }
};

Record read_record(const File& file, std::uint64_t at) {
  Record record;
  const std::uint32_t header_size = file.length(at);
  if (header_size > kMaxHeader) file.fail(at);
  record.header.resize(header_size);
  file.read(at + 4, record.header.data(), header_size);
  record.data_size = file.length(at + 4 + header_size);
  record.data = at + 8 + header_size;
  if (record.end() > file.size()) file.fail(at);
  return record;
}

struct Chunk {
  std::uint64_t data = 0;
  std::uint32_t size = 0;  // uncompressed
  bool compressed = false;
};

Chunk chunk_of(const File& file, const Record& record) {
  const auto size = field<std::uint32_t>(record.header, "size");
  if (!size) file.fail(record.data);
  const bool plain = record.header.find("compression=none") != std::string::npos;
  if (plain && *size != record.data_size) file.fail(record.data);
  return {record.data, *size, !plain};
}

// Checks a message that the index lists at this offset of a chunk.
void check_message(const File& file, const Chunk& chunk, std::uint32_t offset) {
  const auto fits = [&](std::uint64_t end) {
    if (end > chunk.size) file.fail(chunk.data + offset);
  };
  fits(std::uint64_t{offset} + 8);
  if (chunk.compressed) return;  // the decompressor checks bounds
  const std::uint64_t header = file.length(chunk.data + offset);
  fits(offset + header + 8);
  const std::uint64_t data = file.length(chunk.data + offset + 4 + header);
  fits(offset + header + 8 + data);
}

void check_index(const File& file, const Chunk& chunk, const Record& record) {
  constexpr std::size_t kEntry = 12;  // seconds, nanoseconds, offset
  const auto count = field<std::uint32_t>(record.header, "count");
  if (!count || std::uint64_t{*count} * kEntry != record.data_size) file.fail(record.data);
  std::vector<char> entries(record.data_size);
  file.read(record.data, entries.data(), entries.size());
  for (std::size_t i = 0; i < *count; ++i) {
    std::uint32_t offset = 0;
    std::memcpy(&offset, entries.data() + i * kEntry + 8, 4);
    check_message(file, chunk, offset);
  }
}

}  // namespace

void check_bag(const std::filesystem::path& path) {
  const File file(path);
  std::string magic(kMagic.size(), '\0');
  if (file.size() < magic.size()) return;
  file.read(0, magic.data(), magic.size());
  if (magic != kMagic) return;
  Chunk chunk;
  std::set<std::uint64_t> chunks;
  for (std::uint64_t at = kMagic.size(); at < file.size();) {
    const Record record = read_record(file, at);
    const auto op = field<std::uint8_t>(record.header, "op");
    if (op == kChunk) {
      chunk = chunk_of(file, record);
      chunks.insert(at);
    } else if (op == kIndex) {
      check_index(file, chunk, record);
    } else if (op == kChunkInfo) {
      const auto position = field<std::uint64_t>(record.header, "chunk_pos");
      if (!position || !chunks.contains(*position)) file.fail(at);
    }
    at = record.end();
  }
}

}  // namespace apvi::io
