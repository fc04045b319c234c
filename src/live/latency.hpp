// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <mutex>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"

namespace apvi::live {

struct Percentiles {
  double p50_s = 0.0;
  double p95_s = 0.0;
  double p99_s = 0.0;
  std::size_t count = 0;
};

/// Time from the arrival of a sample to the pose that it gives. Thread-safe.
class LatencyMonitor {
 public:
  /// A sample whose stamp is about that of a pose to come.
  void arrived(Stamp stamp, Stamp arrival);
  /// The pose of that stamp is there. Poses that are not near a sample are not counted.
  void done(Stamp stamp, Stamp now);

  /// Of all poses; nullopt before the first.
  std::optional<Percentiles> all() const;
  /// Of about the last ten seconds, for display.
  std::optional<Percentiles> recent() const;

 private:
  mutable std::mutex mutex_;
  std::map<Stamp, Stamp> arrivals_;
  std::vector<double> latencies_s_;
};

}  // namespace apvi::live
