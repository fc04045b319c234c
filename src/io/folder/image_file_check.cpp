// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/image_file_check.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string_view>

namespace apvi::io {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::array<std::uint8_t, 8> kPngSignature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
constexpr std::array<std::uint8_t, 3> kJpegSignature = {0xff, 0xd8, 0xff};

template <std::size_t N>
bool starts_with(Bytes bytes, const std::array<std::uint8_t, N>& signature) {
  return bytes.size() >= N && std::equal(signature.begin(), signature.end(), bytes.begin());
}

// ISO/IEC 15948: chunks of length, type, data and checksum; the last one is IEND.
bool is_complete_png(Bytes bytes) {
  std::size_t at = kPngSignature.size();
  while (at + 12 <= bytes.size()) {
    std::size_t length = 0;
    for (std::size_t i = 0; i < 4; ++i) length = length * 256 + bytes[at + i];
    if (length > bytes.size() - at - 12) return false;
    const auto type = bytes.subspan(at + 4, 4);
    constexpr std::string_view kEnd = "IEND";
    if (std::equal(kEnd.begin(), kEnd.end(), type.begin())) return true;
    at += 12 + length;
  }
  return false;
}

bool has_length(std::uint8_t marker) {
  const bool restart_or_start = marker >= 0xd0 && marker <= 0xd8;
  return marker != 0x00 && marker != 0x01 && marker != 0xff && !restart_or_start;
}

// ISO/IEC 10918-1, annex B: segments of a marker and a length; after the header of a scan follow
// coded data, in which 0xff is followed by zero or a restart marker. A thumbnail lies inside a
// segment, so its end of image is skipped.
bool is_complete_jpeg(Bytes bytes) {
  constexpr std::uint8_t kEndOfImage = 0xd9;
  std::size_t at = 2;
  while (at + 1 < bytes.size()) {
    if (bytes[at] != 0xff) {  // coded data
      const auto next = std::find(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.end(),
                                  std::uint8_t{0xff});
      at = static_cast<std::size_t>(next - bytes.begin());
      continue;
    }
    const std::uint8_t marker = bytes[at + 1];
    if (marker == kEndOfImage) return true;
    if (!has_length(marker)) {
      at += marker == 0xff ? 1 : 2;
      continue;
    }
    if (at + 3 >= bytes.size()) return false;
    at += 2 + std::size_t{bytes[at + 2]} * 256 + bytes[at + 3];
  }
  return false;
}

}  // namespace

bool is_complete_image_file(Bytes bytes) {
  if (starts_with(bytes, kPngSignature)) return is_complete_png(bytes);
  if (starts_with(bytes, kJpegSignature)) return is_complete_jpeg(bytes);
  return true;
}

}  // namespace apvi::io
