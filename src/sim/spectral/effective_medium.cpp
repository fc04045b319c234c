// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/effective_medium.hpp"

#include <cmath>
#include <numbers>

namespace apvi::sim {
namespace {

constexpr double kDark = 1e-5;  // light too weak for a logarithm

double direct_coefficient(const std::vector<SeenSurface>& surfaces, int c) {
  double sum = 0.0;
  double weight = 0.0;
  for (const SeenSurface& s : surfaces) {
    if (s.clear[c] < kDark || s.direct[c] < kDark) continue;
    sum -= s.range * std::log(s.direct[c] / s.clear[c]);
    weight += s.range * s.range;
  }
  return weight > 0.0 ? sum / weight : 0.0;
}

struct BackscatterFit {
  double beta = 0.0, infinity = 0.0, residual = 0.0;
};

// For a given coefficient the backscatter at infinity is linear.
BackscatterFit fit_infinity(const std::vector<SeenBackscatter>& scattered_all, int c, double beta) {
  double xx = 0.0;
  double xy = 0.0;
  double yy = 0.0;
  for (const SeenBackscatter& v : scattered_all) {
    const double x = 1.0 - std::exp(-beta * v.range);
    xx += x * x;
    xy += x * v.scattered[c];
    yy += v.scattered[c] * v.scattered[c];
  }
  const double infinity = xx > 0.0 ? xy / xx : 0.0;
  return {.beta = beta, .infinity = infinity, .residual = yy - infinity * xy};
}

// Golden-section search over the logarithm of the coefficient.
BackscatterFit fit_backscatter(const std::vector<SeenBackscatter>& scattered_all, int c) {
  const auto at = [&](double logarithm) {
    return fit_infinity(scattered_all, c, std::exp(logarithm));
  };
  const double golden = 1.0 / std::numbers::phi;
  double low = std::log(1e-3);
  double high = std::log(20.0);
  for (int i = 0; i < 60; ++i) {
    const double a = high - golden * (high - low);
    const double b = low + golden * (high - low);
    if (at(a).residual < at(b).residual) {
      high = b;
    } else {
      low = a;
    }
  }
  return at(0.5 * (low + high));
}

}  // namespace

Medium effective_medium(const std::vector<SeenSurface>& surfaces,
                        const std::vector<SeenBackscatter>& scattered_all) {
  Medium medium;
  for (int c = 0; c < 3; ++c) {
    medium.beta_d[c] = direct_coefficient(surfaces, c);
    medium.beta_b[c] = medium.beta_d[c];
    if (scattered_all.empty() || scattered_all.back().scattered[c] < kDark) continue;
    const BackscatterFit fit = fit_backscatter(scattered_all, c);
    medium.beta_b[c] = fit.beta;
    medium.b_inf[c] = fit.infinity;
  }
  return medium;
}

}  // namespace apvi::sim
