// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sim/waves.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace apvi::sim {
namespace {

constexpr double kPi = std::numbers::pi;
// A narrow spectrum by hand: one strong component at the dominant period, two weaker beside it, so
// that groups form. The weights' squares add to one.
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
    c.number = c.frequency * c.frequency / gravity;
    c.wave_vector = c.number * Eigen::Vector2d(std::cos(direction), std::sin(direction));
    // Height = 4 sigma, and sigma² = sum amplitude² / 2.
    c.amplitude = config.height_m / 4.0 * std::numbers::sqrt2 * kWeight[i];
    c.phase = random.uniform(0.0, 2.0 * kPi);
  }
}

double WaveField::Component::angle(double x, double y, double t) const {
  return wave_vector.x() * x + wave_vector.y() * y - frequency * t + phase;
}

double WaveField::Component::faded(double depth) const {
  return amplitude * std::exp(-number * std::max(depth, 0.0));
}

Eigen::Vector3d WaveField::displacement(double x, double y, double depth, double t) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Component& c : components_) {
    const double angle = c.angle(x, y, t);
    sum.head<2>() -= c.faded(depth) * std::sin(angle) / c.number * c.wave_vector;
    sum.z() += c.faded(depth) * std::cos(angle);
  }
  return sum;
}

double WaveField::pressure_head(double x, double y, double depth, double t) const {
  double sum = 0.0;
  for (const Component& c : components_) sum += c.faded(depth) * std::cos(c.angle(x, y, t));
  return sum;
}

Eigen::Vector2d WaveField::slope(double x, double y, double depth, double t) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Component& c : components_) {
    sum -= c.faded(depth) * std::sin(c.angle(x, y, t)) * c.wave_vector;
  }
  return sum;
}

}  // namespace apvi::sim
