// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace apvi::doctor {

/// Values from `from` to `to` in equal steps, both ends included.
std::vector<double> steps(double from, double to, double step);

struct Minimum {
  double at = 0.0;
  double value = 0.0;
  std::size_t index = 0;  ///< of the lowest sample
  bool inside = false;    ///< it is no end of the scan
};

/// The lowest of samples at equal steps, refined by the parabola through it and its neighbours.
/// Needs at least one sample.
Minimum lowest(const std::vector<double>& at, const std::vector<double>& values);

/// The standard error of an estimate from what it becomes when one of n groups is left out.
double jackknife_sigma(const std::vector<double>& left_out);

}  // namespace apvi::doctor
