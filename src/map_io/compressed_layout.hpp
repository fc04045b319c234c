// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace apvi::map_io {

inline constexpr int kChunkSize = 256;
inline constexpr double kShRange = 8.0;              // SH coefficients in [-4, 4]
inline constexpr std::size_t kPlainBoundCount = 12;  // of older files, without bounds of colors
inline constexpr std::size_t kBoundCount = 18;

/// Properties of a chunk: minima and maxima of position, log scale and color.
inline std::vector<std::string> bound_names() {
  std::vector<std::string> names;
  for (const char* const end : {"min_", "max_"}) {
    for (const char* const axis : {"x", "y", "z"}) names.push_back(std::string(end) + axis);
  }
  for (const char* const end : {"min_scale_", "max_scale_"}) {
    for (const char* const axis : {"x", "y", "z"}) names.push_back(std::string(end) + axis);
  }
  for (const char* const end : {"min_", "max_"}) {
    for (const char* const channel : {"r", "g", "b"}) names.push_back(std::string(end) + channel);
  }
  return names;
}

inline std::vector<std::string> packed_names() {
  return {"packed_position", "packed_rotation", "packed_scale", "packed_color"};
}

/// Properties f_rest_* of `rest` coefficients per channel.
inline std::vector<std::string> rest_names(std::size_t rest) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < 3 * rest; ++i) names.push_back("f_rest_" + std::to_string(i));
  return names;
}

}  // namespace apvi::map_io
