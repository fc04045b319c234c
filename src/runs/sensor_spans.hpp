// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "apvi/sensors/samples.hpp"

namespace apvi::runs {

/// A span in which a sensor delivered usable samples without an outage, see
/// localization::SensorMonitor.
struct SensorSpan {
  std::string sensor;  ///< name given by `kind_of`
  Stamp begin;         ///< of the first sample
  Stamp end;           ///< of the last one
  std::size_t samples = 0;
};

/// Which sensor served when.
class SensorSpans {
 public:
  /// Every sample, those of each sensor in order of time.
  void add(const SensorEvent& event);
  /// By sensor, in order of time.
  std::vector<SensorSpan> all() const;

 private:
  std::map<std::string, std::vector<SensorSpan>, std::less<>> by_sensor_;
};

}  // namespace apvi::runs
