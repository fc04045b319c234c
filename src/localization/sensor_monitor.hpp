// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::localization {

/// Time without a usable sample after which a sensor counts as silent; `sensor` as in `kind_of`.
/// Longer than the sample period of the slowest sensor of its kind.
Duration outage_timeout(std::string_view sensor);
/// Not a DVL without bottom lock.
bool is_usable(const SensorEvent& event);

/// Interval in which a sensor delivered no usable sample.
struct Outage {
  std::string sensor;          ///< name given by `kind_of`
  Stamp since;                 ///< last sample before the outage
  std::optional<Stamp> until;  ///< first sample after it; empty while it lasts
};

/// Detects sensor outages while other sensors keep reporting, and logs their begin and end. A DVL
/// without bottom lock counts as an outage.
class SensorMonitor {
 public:
  /// Call for every sample of every sensor, roughly in order of time.
  void process(const SensorEvent& event);

  const std::vector<Outage>& outages() const { return outages_; }

 private:
  struct Stream {
    Stamp last;
    std::optional<std::size_t> outage;  // index of the current outage
    int messages = 0;
  };
  void begin_outage(const std::string& sensor, Stream& stream);
  void end_outage(const std::string& sensor, Stream& stream, Stamp now);

  std::map<std::string, Stream> streams_;
  std::optional<Stamp> first_;
  std::vector<Outage> outages_;
};

}  // namespace apvi::localization
