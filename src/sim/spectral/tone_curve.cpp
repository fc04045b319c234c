// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/tone_curve.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace apvi::sim {
namespace {

// IEC 61966-2-1.
double srgb(double light) {
  return light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1.0 / 2.4) - 0.055;
}

}  // namespace

double tone(ToneCurve curve, double gamma, double light) {
  const double x = std::clamp(light, 0.0, 1.0);
  if (curve == ToneCurve::linear) return x;
  if (curve == ToneCurve::gamma) return std::pow(x, 1.0 / gamma);
  const double y = srgb(x);
  constexpr double kContrast = 0.08;
  return curve == ToneCurve::srgb ? y : y - kContrast * std::sin(2.0 * std::numbers::pi * y);
}

ToneTable::ToneTable(ToneCurve curve, double gamma) {
  for (std::size_t i = 0; i < bytes_.size(); ++i) {
    const double value = tone(curve, gamma, static_cast<double>(i) / kSteps);
    bytes_[i] = static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(value, 0.0, 1.0)));
  }
}

}  // namespace apvi::sim
