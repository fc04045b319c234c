// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace apvi::io {

/// What could be decompressed; `complete` is false when the input is damaged or truncated, or when
/// it contains more than the limit.
struct Decompressed {
  std::vector<std::uint8_t> bytes;
  bool complete = false;
};

/// LZ4 frames and Zstandard frames. Memory grows with the bytes that are decompressed, not with a
/// size that the input claims, up to `limit` bytes.
Decompressed decompress_lz4(std::span<const std::uint8_t> input, std::size_t limit);
Decompressed decompress_zstd(std::span<const std::uint8_t> input, std::size_t limit);

/// Whether bytes begin like a Zstandard frame. No CDR message does.
bool is_zstd(std::span<const std::uint8_t> bytes);

}  // namespace apvi::io
