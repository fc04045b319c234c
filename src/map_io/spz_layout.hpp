// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace apvi::map_io {

inline constexpr std::uint32_t kSpzMagic = 0x5053474e;  // "NGSP"
inline constexpr std::size_t kSpzHeaderBytes = 16;
inline constexpr unsigned char kSpzAntialiased = 1;  // a flag

inline constexpr double kSpzColorScale = 0.15;  // of SH coefficients, to leave a margin
inline constexpr double kSpzScaleSteps = 16.0;  // per unit of the logarithm
inline constexpr double kSpzMinLogScale = -10.0;
inline constexpr double kSpzShScale = 128.0;

/// Signs of positions and of the vector part of quaternions under the change of axes.
inline constexpr std::array<float, 3> kSpzAxes = {1.0F, -1.0F, -1.0F};
/// Signs of the SH basis functions of degree 1 to 3: each is even or odd in y and z together.
inline constexpr std::array<float, 15> kSpzShSigns = {-1, -1, 1,  -1, 1, 1,  -1, 1,
                                                      -1, 1,  -1, -1, 1, -1, 1};

}  // namespace apvi::map_io
