// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/scan.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "apvi/core/error.hpp"

namespace apvi::doctor {

std::vector<double> steps(double from, double to, double step) {
  std::vector<double> values;
  const auto count = static_cast<int>(std::lround((to - from) / step));
  for (int i = 0; i <= count; ++i) values.push_back(from + i * step);
  return values;
}

Minimum find_minimum(const std::vector<double>& at, const std::vector<double>& values) {
  APVI_CHECK(!values.empty() && at.size() == values.size());
  const auto it = std::min_element(values.begin(), values.end());
  const auto i = static_cast<std::size_t>(it - values.begin());
  Minimum m{at[i], values[i], i, i > 0 && i + 1 < values.size()};
  if (!m.inside) return m;
  const double curvature = values[i - 1] - 2.0 * values[i] + values[i + 1];
  if (!(curvature > 0.0)) return m;
  const double shift = 0.5 * (values[i - 1] - values[i + 1]) / curvature;
  m.at += shift * (at[i + 1] - at[i]);
  m.value -= 0.5 * curvature * shift * shift;
  return m;
}

double jackknife_sigma(const std::vector<double>& left_out) {
  const auto n = static_cast<double>(left_out.size());
  if (left_out.size() < 2) return 0.0;
  const double mean = std::accumulate(left_out.begin(), left_out.end(), 0.0) / n;
  double sum = 0.0;
  for (const double value : left_out) sum += (value - mean) * (value - mean);
  return std::sqrt(sum * (n - 1.0) / n);
}

}  // namespace apvi::doctor
