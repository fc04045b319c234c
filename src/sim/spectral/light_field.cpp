// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/light_field.hpp"

#include <cmath>
#include <numbers>

#include "sim/spectral/phase_function.hpp"

namespace apvi::sim {
namespace {

constexpr double kEccentricity = 0.9;
constexpr int kPolar = 180;
constexpr int kAround = 48;

double shape(double m) {
  const double x = 1.0 - kEccentricity * m;
  return 1.0 / (x * x);
}

// Integrates value(z, x) over the directions of the sphere with these components.
template <typename Function>
double over_sphere(const Function& value) {
  double sum = 0.0;
  for (int i = 0; i < kPolar; ++i) {
    const double z = -1.0 + 2.0 * (i + 0.5) / kPolar;
    const double side = std::sqrt(1.0 - z * z);
    for (int j = 0; j < kAround; ++j) {
      const double angle = 2.0 * std::numbers::pi * (j + 0.5) / kAround;
      sum += value(z, side * std::cos(angle));
    }
  }
  return sum * 4.0 * std::numbers::pi / (kPolar * kAround);
}

}  // namespace

double diffuse_radiance(double m) {
  static const double downwelling =
      over_sphere([](double z, double) { return z < 0.0 ? -z * shape(-z) : 0.0; });
  return shape(m) / downwelling;
}

const ElevationTable& diffuse_irradiance() {
  static const ElevationTable table = ElevationTable::of([](double up) {
    const double side = std::sqrt(std::fmax(0.0, 1.0 - up * up));
    return over_sphere([&](double z, double x) {
      return diffuse_radiance(-z) * std::fmax(0.0, -(up * z + side * x));
    });
  });
  return table;
}

const ElevationTable& diffuse_scatter() {
  static const ElevationTable table = ElevationTable::of([](double up) {
    const FournierForand phase;
    const double side = std::sqrt(std::fmax(0.0, 1.0 - up * up));
    const double limit = std::cos(kSmallAngle);
    // Light reaches the camera against the direction of view.
    return over_sphere([&](double z, double x) {
      const double cosine = -(up * z + side * x);
      return cosine < limit ? diffuse_radiance(-z) * phase.value(cosine) : 0.0;
    });
  });
  return table;
}

const CosineTable<1024>& wide_phase() {
  static const auto table = CosineTable<1024>::of([](double cosine) {
    return FournierForand().value(std::fmin(cosine, std::cos(kSmallAngle)));
  });
  return table;
}

}  // namespace apvi::sim
