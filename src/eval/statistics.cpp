// SPDX-License-Identifier: BSD-3-Clause
#include "eval/statistics.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::eval {

std::optional<Statistics> summarize(std::vector<double> errors) {
  if (errors.empty()) return std::nullopt;
  std::sort(errors.begin(), errors.end());
  const std::size_t n = errors.size();
  const double count = static_cast<double>(n);
  double sum = 0.0;
  double squares = 0.0;
  for (const double e : errors) {
    sum += e;
    squares += e * e;
  }
  Statistics s;
  s.count = n;
  s.mean = sum / count;
  s.rmse = std::sqrt(squares / count);
  double deviations = 0.0;  // second pass, avoids cancellation
  for (const double e : errors) deviations += (e - s.mean) * (e - s.mean);
  s.std = std::sqrt(deviations / count);
  s.median = 0.5 * (errors[(n - 1) / 2] + errors[n / 2]);
  s.min = errors.front();
  s.max = errors.back();
  return s;
}

}  // namespace apvi::eval
