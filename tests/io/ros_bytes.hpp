// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace apvi::test {

/// Serializes a ROS1 message field by field.
class RosBytes {
 public:
  template <typename T>
  RosBytes& put(T value) {
    const std::size_t size = bytes_.size();
    bytes_.resize(size + sizeof(T));
    std::memcpy(bytes_.data() + size, &value, sizeof(T));
    return *this;
  }
  RosBytes& text(const std::string& text) {
    put(static_cast<std::uint32_t>(text.size()));
    for (const char c : text) put(c);
    return *this;
  }
  /// std_msgs/Header.
  RosBytes& header(std::uint32_t sec, std::uint32_t nsec) {
    return put(std::uint32_t{7}).put(sec).put(nsec).text("frame");
  }
  const std::vector<std::uint8_t>& get() const { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

inline const std::string kSeparator = "\n" + std::string(80, '=') + "\nMSG: ";
inline const std::string kHeaderPart =
    kSeparator + "std_msgs/Header\n# a comment\nuint32 seq\ntime stamp\nstring frame_id\n";
inline const std::string kVectorPart =
    kSeparator + "geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";

}  // namespace apvi::test
