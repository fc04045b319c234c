// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/phase_function.hpp"

#include <cmath>
#include <numbers>

namespace apvi::sim {
namespace {

AngleClass class_between(double low, double high) {
  constexpr int kSteps = 200;
  const FournierForand phase;
  const double width = (high - low) / kSteps;
  double square = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double angle = low + i * width;
    const double middle = angle + 0.5 * width;
    square += (phase.cumulative(angle + width) - phase.cumulative(angle)) * middle * middle;
  }
  const double fraction = phase.cumulative(high) - phase.cumulative(low);
  return {.fraction = fraction, .rms = std::sqrt(0.5 * square / fraction)};
}

}  // namespace

FournierForand::FournierForand(double index, double slope)
    : scale_(4.0 / (3.0 * (index - 1.0) * (index - 1.0))), nu_(0.5 * (3.0 - slope)) {}

double FournierForand::value(double cosine) const {
  const double half = std::fmax(1e-12, 0.5 * (1.0 - cosine));  // sin^2(angle / 2)
  const double delta = scale_ * half;
  const double power = std::pow(delta, nu_);
  const double backward = std::pow(scale_, nu_);
  const double gap = 1.0 - delta;
  const double main = (nu_ * gap - (1.0 - power) + (delta * (1.0 - power) - nu_ * gap) / half) /
                      (4.0 * std::numbers::pi * gap * gap * power);
  const double even = (1.0 - backward) * (3.0 * cosine * cosine - 1.0) /
                      (16.0 * std::numbers::pi * (scale_ - 1.0) * backward);
  return main + even;
}

double FournierForand::cumulative(double angle_rad) const {
  const double sine = std::sin(0.5 * angle_rad);
  const double half = sine * sine;
  if (half <= 0.0) return 0.0;
  const double delta = scale_ * half;
  const double power = std::pow(delta, nu_);
  const double backward = std::pow(scale_, nu_);
  const double main = ((1.0 - delta * power) - (1.0 - power) * half) / ((1.0 - delta) * power);
  const double even = 0.125 * (1.0 - backward) / ((scale_ - 1.0) * backward) * std::cos(angle_rad) *
                      std::sin(angle_rad) * std::sin(angle_rad);
  return main + even;
}

double FournierForand::backscatter_fraction() const {
  return 1.0 - cumulative(0.5 * std::numbers::pi);
}

double sharp_fraction() {
  static const double fraction = FournierForand().cumulative(kSharpAngle);
  return fraction;
}

double small_angle_fraction() {
  static const double fraction = FournierForand().cumulative(kSmallAngle);
  return fraction;
}

const std::array<AngleClass, 3>& small_angle_classes() {
  constexpr double kDegree = std::numbers::pi / 180.0;
  static const std::array<AngleClass, 3> classes{class_between(kSharpAngle, 1.5 * kDegree),
                                                 class_between(1.5 * kDegree, 4.0 * kDegree),
                                                 class_between(4.0 * kDegree, kSmallAngle)};
  return classes;
}

}  // namespace apvi::sim
