// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// The records of an MCAP file, see https://mcap.dev/spec. Each is one byte of its kind, eight
/// bytes of its length, and its content. Numbers are little-endian.
namespace apvi::io {

using Bytes = std::span<const std::uint8_t>;

enum class McapKind : std::uint8_t {
  header = 1,
  footer = 2,
  schema = 3,
  channel = 4,
  message = 5,
  chunk = 6,
  message_index = 7,
  chunk_index = 8,
  statistics = 11,
  data_end = 15
};

inline constexpr std::string_view kMcapMagic = "\x89MCAP0\r\n";
inline constexpr std::uint64_t kMcapRecordPrefix = 9;  // kind and length [bytes]

/// Reads values from bytes. After the end of the bytes every value is zero or empty, and `ok`
/// false.
class ByteReader {
 public:
  explicit ByteReader(Bytes bytes) : rest_(bytes) {}

  template <typename T>
  T number() {
    T value{};
    const Bytes bytes = block(sizeof(T));
    if (ok_) std::memcpy(&value, bytes.data(), sizeof(T));
    return value;
  }
  Bytes block(std::uint64_t count) {
    ok_ = ok_ && count <= rest_.size();
    if (!ok_) return {};
    const Bytes taken = rest_.first(static_cast<std::size_t>(count));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }
  /// Bytes after their length as a number T.
  template <typename T>
  Bytes prefixed() {
    return block(number<T>());
  }
  std::string_view text() {
    const Bytes bytes = prefixed<std::uint32_t>();
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }
  Bytes rest() const { return rest_; }
  bool ok() const { return ok_; }

 private:
  Bytes rest_;
  bool ok_ = true;
};

struct McapRecord {
  McapKind kind{};
  Bytes content;
};

/// The next record; nullopt at the end, or, with `reader.ok()` false, when it is incomplete.
std::optional<McapRecord> next_record(ByteReader& reader);

struct McapSchema {
  std::uint16_t id = 0;
  std::string name;      ///< "sensor_msgs/msg/Imu"
  std::string encoding;  ///< "ros2msg", "protobuf", …
  std::string text;
};

struct McapChannel {
  std::uint16_t id = 0;
  std::uint16_t schema = 0;
  std::string topic;
  std::string encoding;  ///< of the messages: "cdr", "protobuf", …
};

struct McapMessage {
  std::uint16_t channel = 0;
  std::uint64_t log_time = 0;  ///< [ns]
  Bytes data;
};

struct McapChunk {
  std::uint64_t start = 0;  ///< log time of the first message [ns]
  std::uint64_t end = 0;
  std::uint64_t size = 0;  ///< uncompressed
  std::uint32_t crc = 0;   ///< of the uncompressed records; 0: unknown
  std::string compression;
  std::uint64_t stored = 0;  ///< size of the compressed records in the file
};

struct McapChunkIndex {
  std::uint64_t start = 0;
  std::uint64_t end = 0;
  std::uint64_t at = 0;                 ///< of the chunk's record in the file
  std::uint64_t length = 0;             ///< of that record, with its prefix
  std::vector<std::uint16_t> channels;  ///< with messages in it; empty: unknown
};

struct McapStatistics {
  std::uint64_t messages = 0;
  std::uint32_t channels = 0;
  std::uint32_t chunks = 0;
};

/// Parse the content of a record; nullopt when it is too short.
std::optional<McapSchema> parse_schema(Bytes content);
std::optional<McapChannel> parse_channel(Bytes content);
std::optional<McapMessage> parse_message(Bytes content);
/// The beginning of a chunk, up to its records. `reader` is then at the first of them.
std::optional<McapChunk> parse_chunk(ByteReader& reader);
std::optional<McapChunkIndex> parse_chunk_index(Bytes content);
std::optional<McapStatistics> parse_statistics(Bytes content);
/// CRC-32 as zlib computes it.
std::uint32_t crc32(Bytes bytes);

}  // namespace apvi::io
