// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/waves.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace apvi::sim {
namespace {

constexpr double kPi = std::numbers::pi;
// A narrow spectrum: one strong component at the dominant period and a weaker one on each side, so
// that wave groups form. The squares of the weights sum to 1.
constexpr std::array<double, 3> kFrequencyRatio{0.86, 1.0, 1.17};
constexpr std::array<double, 3> kWeight{0.48, 0.76, 0.4386};
constexpr double kSpreadDeg = 20.0;

}  // namespace

WaveField::WaveField(const WaveConfig& config, Random random, double gravity)
    : calm_(config.height_m == 0.0) {
  for (std::size_t i = 0; i < components_.size(); ++i) {
    Component& c = components_[i];
    const double spread = random.uniform(-kSpreadDeg, kSpreadDeg);
    const double direction = (config.direction_deg + spread) * kPi / 180.0;
    c.frequency = 2.0 * kPi / config.period_s * kFrequencyRatio[i];
    c.wave_number = c.frequency * c.frequency / gravity;
    c.wave_vector = c.wave_number * Eigen::Vector2d(std::cos(direction), std::sin(direction));
    // Height = 4 sigma, and sigma² = sum amplitude² / 2.
    c.amplitude = config.height_m / 4.0 * std::numbers::sqrt2 * kWeight[i];
    c.phase = random.uniform(0.0, 2.0 * kPi);
  }
}

double WaveField::Component::angle(double x, double y, double t) const {
  return wave_vector.x() * x + wave_vector.y() * y - frequency * t + phase;
}

double WaveField::Component::amplitude_at(double depth) const {
  return amplitude * std::exp(-wave_number * std::max(depth, 0.0));
}

Eigen::Vector3d WaveField::displacement(double x, double y, double depth, double t) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Component& c : components_) {
    const double angle = c.angle(x, y, t);
    sum.head<2>() -= c.amplitude_at(depth) * std::sin(angle) / c.wave_number * c.wave_vector;
    sum.z() += c.amplitude_at(depth) * std::cos(angle);
  }
  return sum;
}

double WaveField::pressure_head(double x, double y, double depth, double t) const {
  double sum = 0.0;
  for (const Component& c : components_) sum += c.amplitude_at(depth) * std::cos(c.angle(x, y, t));
  return sum;
}

Eigen::Vector2d WaveField::slope(double x, double y, double depth, double t) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Component& c : components_) {
    sum -= c.amplitude_at(depth) * std::sin(c.angle(x, y, t)) * c.wave_vector;
  }
  return sum;
}

}  // namespace apvi::sim
