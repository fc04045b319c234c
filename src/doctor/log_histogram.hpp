// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace apvi::doctor {

/// Quantiles of any number of positive values in bounded memory: bins one percent wide from 1e-9 to
/// 1e9, each with the mean of what fell into it, so that a value that repeats is given back
/// exactly.
class LogHistogram {
 public:
  LogHistogram();

  /// Zero, negative and NaN count as zero; what is out of range goes to the outermost bins.
  void add(double value);
  std::size_t count() const { return count_; }
  /// Mean of the bin that holds the quantile `q` in [0, 1]; zero when empty.
  double quantile(double q) const;
  double median() const { return quantile(0.5); }
  /// Share of the values that are at least `value`, to the width of a bin; zero when empty.
  double share_from(double value) const;

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
