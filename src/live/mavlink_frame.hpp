// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>
#include <vector>

/// The MAVLink protocol (https://mavlink.io/en/guide/serialization.html), as far as `apvi live`
/// needs it: version 1 and 2, with checksums; signatures are skipped.
namespace apvi::live::mavlink {

enum class Id : std::uint32_t {
  heartbeat = 0,
  system_time = 2,
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

/// Finds the frames in a datagram, with known identifiers and a right checksum; others are skipped.
/// Returns how many known messages had a wrong checksum. Never throws, for any bytes.
std::size_t decode(std::span<const std::uint8_t> datagram,
                   const std::function<void(const Frame&)>& take);

/// A frame of version 2. `sequence` counts the frames of the sender.
std::vector<std::uint8_t> encode(const Frame& frame, std::uint8_t sequence);

}  // namespace apvi::live::mavlink
