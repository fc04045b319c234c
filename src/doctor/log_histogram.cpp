// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/log_histogram.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::doctor {
namespace {

constexpr double kLowest = 1e-9;
constexpr std::size_t kBins = 4170;  // ln(1e18) / ln(1.01), plus one for zero

}  // namespace

LogHistogram::LogHistogram() : bins_(kBins) {}

std::size_t LogHistogram::index_of(double value) {
  if (!(value > kLowest)) return 0;
  const double bin = 1.0 + std::log(value / kLowest) / std::log(1.01);
  return static_cast<std::size_t>(std::min(bin, static_cast<double>(kBins - 1)));
}

void LogHistogram::add(double value) {
  Bin& bin = bins_[index_of(value)];
  ++bin.count;
  if (value > 0.0) bin.sum += value;
  ++count_;
}

double LogHistogram::quantile(double q) const {
  if (count_ == 0) return 0.0;
  const auto rank = static_cast<std::size_t>(q * static_cast<double>(count_ - 1));
  std::size_t below = 0;
  for (const Bin& bin : bins_) {
    below += bin.count;
    if (below > rank) return bin.sum / static_cast<double>(bin.count);
  }
  return 0.0;
}

double LogHistogram::fraction_at_least(double value) const {
  if (count_ == 0) return 0.0;
  std::size_t above = 0;
  for (std::size_t i = index_of(value); i < bins_.size(); ++i) above += bins_[i].count;
  return static_cast<double>(above) / static_cast<double>(count_);
}

}  // namespace apvi::doctor
