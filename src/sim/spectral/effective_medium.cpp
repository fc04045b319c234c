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

struct VeilFit {
  double beta = 0.0, infinity = 0.0, residual = 0.0;
};

// For a given coefficient the veil at infinity is linear.
VeilFit fit_infinity(const std::vector<SeenVeil>& veils, int c, double beta) {
  double xx = 0.0;
  double xy = 0.0;
  double yy = 0.0;
  for (const SeenVeil& v : veils) {
    const double x = 1.0 - std::exp(-beta * v.range);
    xx += x * x;
    xy += x * v.veil[c];
    yy += v.veil[c] * v.veil[c];
  }
  const double infinity = xx > 0.0 ? xy / xx : 0.0;
  return {.beta = beta, .infinity = infinity, .residual = yy - infinity * xy};
}

// Golden-section search over the logarithm of the coefficient.
VeilFit fit_veil(const std::vector<SeenVeil>& veils, int c) {
  const auto at = [&](double logarithm) { return fit_infinity(veils, c, std::exp(logarithm)); };
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
                        const std::vector<SeenVeil>& veils) {
  Medium medium;
  for (int c = 0; c < 3; ++c) {
    medium.beta_d[c] = direct_coefficient(surfaces, c);
    medium.beta_b[c] = medium.beta_d[c];
    if (veils.empty() || veils.back().veil[c] < kDark) continue;
    const VeilFit fit = fit_veil(veils, c);
    medium.beta_b[c] = fit.beta;
    medium.b_inf[c] = fit.infinity;
  }
  return medium;
}

}  // namespace apvi::sim
