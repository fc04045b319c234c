// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace apvi::eval {

/// Summary statistics of errors, in their unit.
struct Statistics {
  double rmse = 0.0;
  double mean = 0.0;
  double median = 0.0;  ///< mean of the middle two for an even count
  double std = 0.0;     ///< population standard deviation
  double min = 0.0;
  double max = 0.0;
  std::size_t count = 0;
};

/// Empty for no errors.
std::optional<Statistics> summarize(std::vector<double> errors);

}  // namespace apvi::eval
