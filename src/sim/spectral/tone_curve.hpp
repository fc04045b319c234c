// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

namespace apvi::sim {

enum class ToneCurve { linear, srgb, gamma, film };

/// Pixel value of linear light, both 0 to 1. `film` is the sRGB curve y followed by the S-shaped
/// contrast y - 0.08 sin(2 pi y).
double tone(ToneCurve curve, double gamma, double light);

/// The curve as a table from light, in steps of 1/16383, to bytes.
class ToneTable {
 public:
  ToneTable(ToneCurve curve, double gamma);

  std::uint8_t operator()(float light) const {
    const float x = light < 0.0F ? 0.0F : (light > 1.0F ? 1.0F : light);
    return bytes_[static_cast<std::size_t>(std::lround(x * kSteps))];
  }

 private:
  static constexpr int kSteps = 16383;
  std::array<std::uint8_t, kSteps + 1> bytes_{};
};

}  // namespace apvi::sim
