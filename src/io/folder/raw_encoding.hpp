// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string_view>

namespace apvi::io {

inline constexpr int kNoConversion = -1;

/// How the rows of an uncompressed image are laid out, by its ROS encoding.
struct Encoding {
  std::string_view name;
  int type = 0;                    ///< of the rows, an OpenCV matrix type
  int conversion = kNoConversion;  ///< OpenCV color conversion to BGR
  bool half_planes = false;        ///< half as many rows of color follow the brightness (YUV 4:2:0)

  bool is_bayer() const { return name.starts_with("bayer_"); }
  /// Rows of bytes in an image of `height` pixels.
  std::size_t rows(std::size_t height) const { return half_planes ? height + height / 2 : height; }
};

/// Null for an encoding that is not supported. Upper and lower case do not matter.
const Encoding* find_encoding(std::string_view name);

}  // namespace apvi::io
