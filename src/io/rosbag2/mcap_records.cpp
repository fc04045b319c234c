// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/mcap_records.hpp"

#include <array>

namespace apvi::io {
namespace {

std::string as_text(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

template <typename T>
std::optional<T> if_ok(const ByteReader& reader, T value) {
  return reader.ok() ? std::optional<T>(std::move(value)) : std::nullopt;
}

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < table.size(); ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) {
      value = (value & 1U) != 0 ? (value >> 1U) ^ 0xedb88320U : value >> 1U;
    }
    table[i] = value;
  }
  return table;
}

}  // namespace

std::optional<McapRecord> next_record(ByteReader& reader) {
  if (reader.rest().empty()) return std::nullopt;
  McapRecord record;
  record.kind = static_cast<McapKind>(reader.number<std::uint8_t>());
  record.content = reader.prefixed<std::uint64_t>();
  return if_ok(reader, record);
}

std::optional<McapSchema> parse_schema(Bytes content) {
  ByteReader reader(content);
  McapSchema schema;
  schema.id = reader.number<std::uint16_t>();
  schema.name = reader.text();
  schema.encoding = reader.text();
  schema.text = as_text(reader.prefixed<std::uint32_t>());
  return if_ok(reader, std::move(schema));
}

std::optional<McapChannel> parse_channel(Bytes content) {
  ByteReader reader(content);
  McapChannel channel;
  channel.id = reader.number<std::uint16_t>();
  channel.schema = reader.number<std::uint16_t>();
  channel.topic = reader.text();
  channel.encoding = reader.text();
  return if_ok(reader, std::move(channel));
}

std::optional<McapMessage> parse_message(Bytes content) {
  ByteReader reader(content);
  McapMessage message;
  message.channel = reader.number<std::uint16_t>();
  reader.number<std::uint32_t>();  // sequence number
  message.log_time = reader.number<std::uint64_t>();
  reader.number<std::uint64_t>();  // time of publication
  message.data = reader.rest();
  return if_ok(reader, message);
}

std::optional<McapChunk> parse_chunk(ByteReader& reader) {
  McapChunk chunk;
  chunk.start = reader.number<std::uint64_t>();
  chunk.end = reader.number<std::uint64_t>();
  chunk.size = reader.number<std::uint64_t>();
  chunk.crc = reader.number<std::uint32_t>();
  chunk.compression = reader.text();
  chunk.stored = reader.number<std::uint64_t>();
  return if_ok(reader, std::move(chunk));
}

std::optional<McapChunkIndex> parse_chunk_index(Bytes content) {
  ByteReader reader(content);
  McapChunkIndex index;
  index.start = reader.number<std::uint64_t>();
  index.end = reader.number<std::uint64_t>();
  index.at = reader.number<std::uint64_t>();
  index.length = reader.number<std::uint64_t>();
  ByteReader channels(reader.prefixed<std::uint32_t>());
  while (reader.ok() && channels.ok() && !channels.rest().empty()) {
    index.channels.push_back(channels.number<std::uint16_t>());
    channels.number<std::uint64_t>();  // where the index of its messages is
  }
  return channels.ok() ? if_ok(reader, std::move(index)) : std::nullopt;
}

std::optional<McapStatistics> parse_statistics(Bytes content) {
  ByteReader reader(content);
  McapStatistics statistics;
  statistics.messages = reader.number<std::uint64_t>();
  reader.number<std::uint16_t>();  // schemas
  statistics.channels = reader.number<std::uint32_t>();
  reader.number<std::uint32_t>();  // attachments
  reader.number<std::uint32_t>();  // metadata
  statistics.chunks = reader.number<std::uint32_t>();
  return if_ok(reader, statistics);
}

std::uint32_t crc32(Bytes bytes) {
  static constexpr auto kTable = make_crc_table();
  std::uint32_t crc = ~0U;
  for (const std::uint8_t byte : bytes) crc = kTable[(crc ^ byte) & 0xffU] ^ (crc >> 8U);
  return ~crc;
}

}  // namespace apvi::io
