// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/sensor.hpp"

#include <Eigen/LU>
#include <cmath>

namespace apvi::sim {
namespace {

constexpr std::array<Spectrum, 3> kNikonD5100{
    {{0.0014, 0.0433, 0.0615, 0.0449, 0.0502, 0.0542, 0.0957, 0.0788, 0.0685, 0.5546, 0.9263, 0.703,
      0.448, 0.2265, 0.0375, 0.0024},
     {0.0014, 0.0672, 0.1675, 0.2716, 0.4444, 0.6332, 0.9158, 0.95, 0.7672, 0.4939, 0.2253, 0.0779,
      0.0366, 0.0192, 0.0043, 0.0005},
     {0.0086, 0.3764, 0.8618, 0.9824, 0.8841, 0.5707, 0.2671, 0.113, 0.0391, 0.0145, 0.0067, 0.0039,
      0.0051, 0.0052, 0.0014, 0.0003}}};
constexpr std::array<Spectrum, 3> kGalaxyS20{
    {{0.0212, 0.0261, 0.0219, 0.0173, 0.0233, 0.0319, 0.0585, 0.0611, 0.0533, 0.379, 0.802, 0.687,
      0.49, 0.2883, 0.1172, 0.0265},
     {0.026, 0.0281, 0.0363, 0.0756, 0.4368, 0.8282, 0.9742, 0.99, 0.8968, 0.7163, 0.4337, 0.1982,
      0.1004, 0.0596, 0.0371, 0.0154},
     {0.1022, 0.307, 0.51, 0.6188, 0.6398, 0.5132, 0.295, 0.1635, 0.0892, 0.0585, 0.0439, 0.0328,
      0.0319, 0.0309, 0.0192, 0.0066}}};

double product(const Spectrum& a, const Spectrum& b) {
  double sum = 0.0;
  for (std::size_t k = 0; k < kBands; ++k) sum += a[k] * b[k];
  return sum;
}

double logistic(double x) {
  return 1.0 / (1.0 + std::exp(-x));
}

}  // namespace

Eigen::Vector3d Sensor::raw(const Spectrum& light) const {
  return {product(response[0], light), product(response[1], light), product(response[2], light)};
}

Spectrum daylight_spectrum() {
  double sum = 0.0;
  for (const double power : kDaylightD65) sum += power;
  return make_spectrum([&](int k) { return kDaylightD65[static_cast<std::size_t>(k)] / sum; });
}

Sensor make_sensor(SensorType type) {
  Sensor sensor{type == SensorType::nikon_d5100 ? kNikonD5100 : kGalaxyS20};
  const Spectrum daylight = daylight_spectrum();
  for (Spectrum& channel : sensor.response) {
    const double white = product(channel, daylight);
    for (double& value : channel) value /= white;
  }
  return sensor;
}

std::array<Spectrum, 3> reflectance_basis() {
  constexpr double kWidth = 15.0;
  std::array<Spectrum, 3> basis{};
  basis[2] = make_spectrum([](int k) { return logistic((495.0 - wavelength_nm(k)) / kWidth); });
  basis[0] = make_spectrum([](int k) { return logistic((wavelength_nm(k) - 585.0) / kWidth); });
  for (std::size_t k = 0; k < kBands; ++k) basis[1][k] = 1.0 - basis[0][k] - basis[2][k];
  return basis;
}

Eigen::Matrix3d color_matrix(const Sensor& sensor) {
  const std::array<Spectrum, 3> basis = reflectance_basis();
  const Spectrum daylight = daylight_spectrum();
  Eigen::Matrix3d seen;
  for (int j = 0; j < 3; ++j) {
    Spectrum light{};
    for (std::size_t k = 0; k < kBands; ++k)
      light[k] = basis[static_cast<std::size_t>(j)][k] * daylight[k];
    seen.col(j) = sensor.raw(light);
  }
  return seen.inverse();
}

}  // namespace apvi::sim
