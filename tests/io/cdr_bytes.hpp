// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <string>
#include <vector>

namespace apvi::test {

/// Serializes a ROS 2 message (CDR) field by field.
class CdrBytes {
 public:
  explicit CdrBytes(bool big_endian = false)
      : big_endian_(big_endian), bytes_{0, static_cast<std::uint8_t>(big_endian ? 0 : 1), 0, 0} {}

  template <typename T>
  CdrBytes& put(T value) {
    while ((bytes_.size() - 4) % sizeof(T) != 0) bytes_.push_back(0);
    auto raw = std::bit_cast<std::array<std::uint8_t, sizeof(T)>>(value);
    if (big_endian_) std::reverse(raw.begin(), raw.end());
    bytes_.insert(bytes_.end(), raw.begin(), raw.end());
    return *this;
  }
  CdrBytes& text(const std::string& text) {
    put(static_cast<std::uint32_t>(text.size() + 1));
    bytes_.insert(bytes_.end(), text.begin(), text.end());
    bytes_.push_back(0);
    return *this;
  }
  CdrBytes& block(const std::vector<std::uint8_t>& block) {
    put(static_cast<std::uint32_t>(block.size()));
    bytes_.insert(bytes_.end(), block.begin(), block.end());
    return *this;
  }
  CdrBytes& zeros(int count) {
    for (int i = 0; i < count; ++i) put(0.0);
    return *this;
  }
  /// std_msgs/Header.
  CdrBytes& header(std::int64_t ns) {
    put(static_cast<std::int32_t>(ns / 1'000'000'000));
    return put(static_cast<std::uint32_t>(ns % 1'000'000'000)).text("frame");
  }
  const std::vector<std::uint8_t>& get() const { return bytes_; }

 private:
  bool big_endian_;
  std::vector<std::uint8_t> bytes_;
};

/// sensor_msgs/Imu with these angular velocities.
inline std::vector<std::uint8_t> cdr_imu(std::int64_t ns, double wx, bool big_endian = false) {
  CdrBytes bytes(big_endian);
  bytes.header(ns).zeros(3).put(1.0).zeros(9).put(wx).put(-0.2).put(0.3).zeros(9);
  return bytes.put(1.0).put(2.0).put(9.8).zeros(9).get();
}

/// nav_msgs/Odometry with this z.
inline std::vector<std::uint8_t> cdr_odometry(std::int64_t ns, double x, double z) {
  CdrBytes bytes;
  bytes.header(ns).text("child").put(x).put(0.0).put(z).zeros(3).put(1.0);
  return bytes.zeros(36 + 6 + 36).get();
}

/// dvl_msgs/DVL in its first layout, with one beam.
inline std::vector<std::uint8_t> cdr_dvl(std::int64_t ns, double vx) {
  CdrBytes bytes;
  bytes.header(ns).put(0.0).put(vx).put(-0.25).put(0.125).put(0.004).put(2.5);
  bytes.put(std::uint32_t{1}).put(std::int64_t{2}).put(0.7).put(3.5).zeros(2);
  return bytes.put(std::uint8_t{1}).put(std::uint8_t{1}).put(std::int64_t{0}).text("json_v3").get();
}

/// sensor_msgs/CompressedImage.
inline std::vector<std::uint8_t> cdr_image(std::int64_t ns, const std::vector<std::uint8_t>& file) {
  return CdrBytes().header(ns).text("png").block(file).get();
}

}  // namespace apvi::test
