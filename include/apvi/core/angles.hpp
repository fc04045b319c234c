// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

inline constexpr double kRadians = 0.017453292519943295;  ///< of a degree
inline constexpr double kDegrees = 57.29577951308232;     ///< of a radian

}  // namespace apvi
