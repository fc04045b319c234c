// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace apvi::doctor {

/// Quantiles of positive values in bounded memory: bins of 1 % width from 1e-9 to 1e9 that store
/// the mean of their values, so that a repeated value is returned exactly.
class LogHistogram {
 public:
  LogHistogram();

  /// Zero, negative values and NaN count as zero; values out of range go to the outermost bins.
  void add(double value);
  std::size_t count() const { return count_; }
  /// Mean of the bin that holds the quantile `q` in [0, 1]; zero when empty.
  double quantile(double q) const;
  double median() const { return quantile(0.5); }
  /// Fraction of values that are at least `value`, within a bin's width; zero when empty.
  double fraction_at_least(double value) const;

 private:
  struct Bin {
    std::size_t count = 0;
    double sum = 0.0;
  };
  static std::size_t index_of(double value);

  std::vector<Bin> bins_;
  std::size_t count_ = 0;
};

}  // namespace apvi::doctor
