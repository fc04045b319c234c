// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/semicircle.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace apvi::fusion {
namespace {

double misfit(const std::vector<double>& sorted, double mean, double radius) {
  const double n = static_cast<double>(sorted.size());
  double worst = 0.0;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const double expected = semicircle_cdf(sorted[i], mean, radius);
    const double below = static_cast<double>(i) / n;
    worst = std::max({worst, std::abs(expected - below), std::abs(below + 1.0 / n - expected)});
  }
  return worst;
}

std::vector<double> usable(const std::vector<double>& values, bool logarithmic) {
  std::vector<double> result;
  for (const double value : values) {
    if (!std::isfinite(value) || (logarithmic && value <= 0.0)) continue;
    result.push_back(logarithmic ? std::log10(value) : value);
  }
  std::sort(result.begin(), result.end());
  return result;
}

std::optional<Semicircle> fit_better(const std::vector<double>& values) {
  const auto plain = fit_semicircle(values, false);
  const auto logarithmic = fit_semicircle(values, true);
  if (!plain || !logarithmic) return logarithmic;
  return plain->lower_edge > 0.0 && plain->misfit <= logarithmic->misfit ? plain : logarithmic;
}

}  // namespace

double wigner_lower_edge(double mean, double sigma, int size) {
  return mean - 2.0 * sigma * std::sqrt(static_cast<double>(size));
}

double semicircle_cdf(double x, double mean, double radius) {
  const double u = std::clamp((x - mean) / radius, -1.0, 1.0);
  return 0.5 + (u * std::sqrt(1.0 - u * u) + std::asin(u)) / std::numbers::pi;
}

std::optional<Semicircle> fit_semicircle(const std::vector<double>& values, bool logarithmic) {
  const std::vector<double> sorted = usable(values, logarithmic);
  if (sorted.size() < 2 || sorted.front() == sorted.back()) return std::nullopt;
  const double n = static_cast<double>(sorted.size());
  const double mean = std::accumulate(sorted.begin(), sorted.end(), 0.0) / n;
  double squares = 0.0;
  for (const double x : sorted) squares += (x - mean) * (x - mean);
  const double deviation = std::sqrt(squares / n);
  const double edge = mean - 2.0 * deviation;
  const auto below = std::lower_bound(sorted.begin(), sorted.end(), edge) - sorted.begin();
  return Semicircle{.mean = mean,
                    .deviation = deviation,
                    .logarithmic = logarithmic,
                    .lower_edge = logarithmic ? std::pow(10.0, edge) : edge,
                    .misfit = misfit(sorted, mean, 2.0 * deviation),
                    .share_below = static_cast<double>(below) / n,
                    .count = sorted.size()};
}

std::optional<ThresholdFit> fit_semicircle(const std::vector<Eigenvalues>& samples) {
  std::vector<double> rotation;
  std::vector<double> position;
  for (const Eigenvalues& sample : samples) {
    rotation.insert(rotation.end(), sample.rotation.begin(), sample.rotation.end());
    position.insert(position.end(), sample.position.begin(), sample.position.end());
  }
  const auto rotation_fit = fit_better(rotation);
  const auto position_fit = fit_better(position);
  if (!rotation_fit || !position_fit) return std::nullopt;
  return ThresholdFit{*rotation_fit, *position_fit};
}

}  // namespace apvi::fusion
