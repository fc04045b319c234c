// SPDX-License-Identifier: BSD-3-Clause
#include "io/mavlink/frame.hpp"

#include <algorithm>
#include <bit>
#include <optional>

namespace apvi::io::mavlink {
namespace {

static_assert(std::endian::native == std::endian::little);

using Bytes = std::span<const std::uint8_t>;

constexpr std::uint8_t kMagic1 = 0xFE;
constexpr std::uint8_t kMagic2 = 0xFD;
constexpr std::size_t kHeader1 = 6;
constexpr std::size_t kHeader2 = 10;
constexpr std::size_t kChecksum = 2;
constexpr std::size_t kSignature = 13;
constexpr std::uint8_t kSigned = 0x01;

// CRC_EXTRA protects against different definitions of a message; the size includes extensions. Both
// are in the generated code of the message set.
struct Definition {
  Id id;
  std::uint8_t crc_extra;
  std::uint8_t size;
};
constexpr Definition kDefinitions[] = {
    {Id::heartbeat, 50, 9},
    {Id::system_time, 137, 12},
    {Id::param_value, 220, 25},
    {Id::gps_raw_int, 24, 52},
    {Id::scaled_imu, 170, 24},
    {Id::raw_imu, 144, 29},
    {Id::scaled_pressure, 115, 16},
    {Id::highres_imu, 93, 63},
    {Id::timesync, 34, 18},
    {Id::scaled_imu2, 76, 24},
    {Id::scaled_imu3, 46, 24},
    {Id::scaled_pressure2, 195, 16},
    {Id::scaled_pressure3, 131, 16},
    {Id::odometry, 91, 233},
    {Id::vision_position_delta, 106, 44},
};

const Definition* find(Id id) {
  const auto* found = std::ranges::find(kDefinitions, id, &Definition::id);
  return found == std::end(kDefinitions) ? nullptr : found;
}

// CRC-16/MCRF4XX, as X.25 without the final inversion.
std::uint16_t checksum(Bytes bytes, std::uint8_t extra) {
  std::uint16_t crc = 0xFFFF;
  const auto add = [&crc](std::uint8_t byte) {
    auto low = static_cast<std::uint8_t>(byte ^ (crc & 0xFF));
    low = static_cast<std::uint8_t>(low ^ (low << 4));
    crc = static_cast<std::uint16_t>((crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4));
  };
  for (const std::uint8_t byte : bytes) add(byte);
  add(extra);
  return crc;
}

struct Header {
  std::size_t size = 0;        // of the header
  std::size_t payload = 0;     // size
  std::size_t frame_size = 0;  // with checksum and signature
  bool readable = true;        // false: flags of an unknown extension
};

// nullopt unless a whole frame begins the bytes.
std::optional<Header> header_of(Bytes bytes) {
  Header header;
  if (bytes.size() >= kHeader1 && bytes[0] == kMagic1) {
    header = {.size = kHeader1, .payload = bytes[1]};
  } else if (bytes.size() >= kHeader2 && bytes[0] == kMagic2) {
    header = {.size = kHeader2, .payload = bytes[1], .readable = (bytes[2] & ~kSigned) == 0};
  } else {
    return std::nullopt;
  }
  const bool has_signature = header.size == kHeader2 && (bytes[2] & kSigned) != 0;
  header.frame_size = header.size + header.payload + kChecksum + (has_signature ? kSignature : 0);
  if (header.frame_size > bytes.size()) return std::nullopt;
  return header;
}

Frame frame_of(Bytes bytes, const Header& header) {
  Frame frame;
  const bool first = header.size == kHeader1;
  frame.system = bytes[first ? 3 : 5];
  frame.component = bytes[first ? 4 : 6];
  const std::uint32_t id =
      first ? bytes[5] : bytes[7] | std::uint32_t{bytes[8]} << 8 | std::uint32_t{bytes[9]} << 16;
  frame.id = static_cast<Id>(id);
  std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(header.size), header.payload,
              frame.payload.begin());
  return frame;
}

bool is_intact(Bytes bytes, const Header& header, std::uint8_t crc_extra) {
  const std::size_t end = header.size + header.payload;
  const std::uint16_t crc = checksum(bytes.subspan(1, end - 1), crc_extra);
  return bytes[end] == (crc & 0xFF) && bytes[end + 1] == (crc >> 8);
}

}  // namespace

bool is_magic(std::uint8_t byte) {
  return byte == kMagic1 || byte == kMagic2;
}

FrameStart frame_at(std::span<const std::uint8_t> bytes) {
  using Kind = FrameStart::Kind;
  const auto header = header_of(bytes);
  if (!header || !header->readable) return {};
  FrameStart start{.kind = Kind::unknown, .size = header->frame_size};
  const Frame frame = frame_of(bytes, *header);
  const Definition* definition = find(frame.id);
  if (definition == nullptr) return start;
  start.kind = is_intact(bytes, *header, definition->crc_extra) ? Kind::intact : Kind::damaged;
  if (start.kind == Kind::intact) start.frame = frame;
  return start;
}

std::size_t decode(std::span<const std::uint8_t> datagram,
                   const std::function<void(const Frame&)>& take) {
  Bytes bytes = datagram;
  std::size_t damaged = 0;
  while (!bytes.empty()) {
    using Kind = FrameStart::Kind;
    const FrameStart start = frame_at(bytes);
    // An unknown message cannot be checked: it is one if another follows it.
    const bool ends_well = start.size == bytes.size() || is_magic(bytes[start.size]);
    const bool is_whole = start.kind == Kind::intact || (start.kind == Kind::unknown && ends_well);
    if (start.kind == Kind::intact) take(start.frame);
    if (start.kind == Kind::damaged) ++damaged;
    bytes = bytes.subspan(is_whole ? start.size : 1);
  }
  return damaged;
}

std::vector<std::uint8_t> encode(const Frame& frame, std::uint8_t sequence) {
  const Definition* definition = find(frame.id);
  std::size_t size = definition == nullptr ? frame.payload.size() : definition->size;
  while (size > 1 && frame.payload[size - 1] == 0) --size;  // version 2 cuts zeros at the end
  const auto id = static_cast<std::uint32_t>(frame.id);
  std::vector<std::uint8_t> bytes(kHeader2 + size);
  bytes[0] = kMagic2;
  bytes[1] = static_cast<std::uint8_t>(size);
  bytes[4] = sequence;
  bytes[5] = frame.system;
  bytes[6] = frame.component;
  for (unsigned i = 0; i < 3; ++i) bytes[7 + i] = static_cast<std::uint8_t>(id >> (8 * i));
  std::copy_n(frame.payload.begin(), size, bytes.begin() + kHeader2);
  const std::uint16_t crc =
      checksum(Bytes(bytes).subspan(1), definition == nullptr ? 0 : definition->crc_extra);
  bytes.push_back(static_cast<std::uint8_t>(crc));
  bytes.push_back(static_cast<std::uint8_t>(crc >> 8));
  return bytes;
}

}  // namespace apvi::io::mavlink
