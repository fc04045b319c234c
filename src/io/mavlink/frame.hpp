// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>
#include <vector>

/// The MAVLink protocol (https://mavlink.io/en/guide/serialization.html), as far as live vehicles
/// and their logs need it: version 1 and 2, with checksums; signatures are skipped.
namespace apvi::io::mavlink {

enum class Id : std::uint32_t {
  heartbeat = 0,
  system_time = 2,
  param_value = 22,
  gps_raw_int = 24,
  scaled_imu = 26,
  raw_imu = 27,
  scaled_pressure = 29,
  highres_imu = 105,
  timesync = 111,
  scaled_imu2 = 116,
  scaled_imu3 = 129,
  scaled_pressure2 = 137,
  scaled_pressure3 = 143,
  odometry = 331,
  vision_position_delta = 11011,
};

/// A message. The payload is filled up with zeros, as the protocol has it for shorter ones.
struct Frame {
  std::uint8_t system = 0;
  std::uint8_t component = 0;
  Id id = Id::heartbeat;
  std::array<std::uint8_t, 255> payload{};

  /// The little-endian field of type T at an offset.
  template <typename T>
  T get(std::size_t offset) const {
    T value;
    std::memcpy(&value, payload.data() + offset, sizeof value);
    return value;
  }
  template <typename T>
  void set(std::size_t offset, T value) {
    std::memcpy(payload.data() + offset, &value, sizeof value);
  }
};

/// What the first of the bytes begins.
struct FrameStart {
  enum class Kind {
    none,     ///< no frame, or not all of it
    intact,   ///< of a known message, with a right checksum
    damaged,  ///< of a known message, with a wrong checksum
    unknown   ///< of another message, which cannot be checked
  };
  Kind kind = Kind::none;
  std::size_t size = 0;  ///< of the frame [bytes]; 0 for `none`
  Frame frame = {};      ///< if intact
};
FrameStart frame_at(std::span<const std::uint8_t> bytes);
/// Size of the largest frame [bytes].
inline constexpr std::size_t kMaxFrame = 280;
/// Whether a frame may begin with this byte.
bool is_magic(std::uint8_t byte);

/// Finds the frames in a datagram, with known identifiers and a right checksum; others are skipped.
/// Returns how many known messages had a wrong checksum. Never throws, for any bytes.
std::size_t decode(std::span<const std::uint8_t> datagram,
                   const std::function<void(const Frame&)>& take);

/// A frame of version 2. `sequence` counts the frames of the sender.
std::vector<std::uint8_t> encode(const Frame& frame, std::uint8_t sequence);

}  // namespace apvi::io::mavlink
