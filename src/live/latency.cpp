// SPDX-License-Identifier: BSD-3-Clause
#include "live/latency.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::live {
namespace {

constexpr std::size_t kMaxArrivals = 1024;
constexpr std::size_t kRecent = 200;
// The pose's stamp differs from the sample's by the time offset of the sensor.
constexpr Duration kTolerance{50'000'000};

std::optional<Percentiles> percentiles(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  std::ranges::sort(values);
  const auto at = [&](double fraction) {
    const double last = static_cast<double>(values.size() - 1);
    return values[static_cast<std::size_t>(std::lround(fraction * last))];
  };
  return Percentiles{
      .p50_s = at(0.5), .p95_s = at(0.95), .p99_s = at(0.99), .count = values.size()};
}

Duration distance(Stamp a, Stamp b) {
  return a > b ? a - b : b - a;
}

}  // namespace

void LatencyMonitor::arrived(Stamp stamp, Stamp arrival) {
  const std::scoped_lock lock(mutex_);
  arrivals_[stamp] = arrival;
  if (arrivals_.size() > kMaxArrivals) arrivals_.erase(arrivals_.begin());
}

void LatencyMonitor::done(Stamp stamp, Stamp now) {
  const std::scoped_lock lock(mutex_);
  auto nearest = arrivals_.lower_bound(stamp);
  if (nearest != arrivals_.begin()) {
    const auto before = std::prev(nearest);
    const bool closer = nearest == arrivals_.end() ||
                        distance(before->first, stamp) < distance(nearest->first, stamp);
    if (closer) nearest = before;
  }
  if (nearest == arrivals_.end() || distance(nearest->first, stamp) > kTolerance) return;
  latencies_s_.push_back(seconds_between(nearest->second, now));
}

std::optional<Percentiles> LatencyMonitor::all() const {
  const std::scoped_lock lock(mutex_);
  return percentiles(latencies_s_);
}

std::optional<Percentiles> LatencyMonitor::recent() const {
  const std::scoped_lock lock(mutex_);
  const std::size_t count = std::min(kRecent, latencies_s_.size());
  return percentiles({latencies_s_.end() - static_cast<std::ptrdiff_t>(count), latencies_s_.end()});
}

}  // namespace apvi::live
