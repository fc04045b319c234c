// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

inline constexpr double kRadiansPerDegree = 0.017453292519943295;
inline constexpr double kDegreesPerRadian = 57.29577951308232;

/// Standard acceleration of gravity [m/s²].
inline constexpr double kStandardGravity = 9.80665;

}  // namespace apvi
