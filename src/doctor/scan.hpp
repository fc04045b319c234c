// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace apvi::doctor {

/// Values from `from` to `to` with spacing `step`, both ends included.
std::vector<double> steps(double from, double to, double step);

struct Minimum {
  double at = 0.0;
  double value = 0.0;
  std::size_t index = 0;  ///< of the lowest sample
  bool inside = false;    ///< not at an end of the scan
};

/// Minimum of equally spaced samples, refined by a parabola through the lowest sample and its
/// neighbors. Requires at least one sample.
Minimum find_minimum(const std::vector<double>& at, const std::vector<double>& values);

/// Jackknife standard error from the estimates with one of n groups left out.
double jackknife_sigma(const std::vector<double>& left_out);

}  // namespace apvi::doctor
