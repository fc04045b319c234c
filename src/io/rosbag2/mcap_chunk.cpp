// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <utility>

#include "io/rosbag2/decompress.hpp"
#include "io/rosbag2/mcap_index.hpp"

namespace apvi::io {
namespace {

constexpr std::uint64_t kMaxChunk = 1ULL << 30U;  // bytes; writers use about a megabyte

// The stored records of an uncompressed chunk, without a copy.
McapRecords plain_records(std::vector<std::uint8_t> storage, Bytes stored, std::uint64_t size) {
  McapRecords loaded;
  loaded.complete = stored.size() == size;
  loaded.records = stored;
  loaded.storage = std::move(storage);  // keeps the address of its bytes
  return loaded;
}

McapRecords decompressed_records(const McapChunk& chunk, Bytes stored) {
  const auto limit = static_cast<std::size_t>(chunk.size);
  Decompressed result;
  if (chunk.compression == "lz4") result = decompress_lz4(stored, limit);
  if (chunk.compression == "zstd") result = decompress_zstd(stored, limit);
  McapRecords loaded;
  loaded.complete = result.complete && result.bytes.size() == limit;
  loaded.storage = std::move(result.bytes);
  loaded.records = loaded.storage;
  return loaded;
}

}  // namespace

McapRecords load_part(const BinaryFile& file, const McapPart& part) {
  if (part.length > kMaxChunk) return {};
  std::vector<std::uint8_t> storage = file.read_block(part.at, part.length);
  const bool whole = storage.size() == part.length;
  if (!part.chunk) {
    const Bytes records = storage;
    return plain_records(std::move(storage), records, part.length);
  }
  ByteReader reader(storage);
  const auto chunk = parse_chunk(reader);
  if (!chunk || chunk->size > kMaxChunk) return {};
  const std::uint64_t present = std::min<std::uint64_t>(chunk->stored, reader.rest().size());
  const Bytes stored = reader.rest().first(static_cast<std::size_t>(present));
  McapRecords loaded = chunk->compression.empty()
                           ? plain_records(std::move(storage), stored, chunk->size)
                           : decompressed_records(*chunk, stored);
  loaded.complete = loaded.complete && whole;
  // Wrong bytes could be anywhere in the chunk.
  if (loaded.complete && chunk->crc != 0 && crc32(loaded.records) != chunk->crc) return {};
  return loaded;
}

}  // namespace apvi::io
