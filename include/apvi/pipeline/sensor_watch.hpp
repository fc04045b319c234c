// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::pipeline {

/// A span in which a sensor said nothing that can be used.
struct Outage {
  std::string sensor;          ///< as `kind_of` calls it
  Stamp since;                 ///< its last sample before
  std::optional<Stamp> until;  ///< its first one after; nothing while it lasts
};

/// Notices sensors that fall silent while others go on, and says so in the log, then and when they
/// are back. A DVL without bottom lock counts as silent.
class SensorWatch {
 public:
  /// Every sample of every sensor, about in order of time.
  void see(const SensorEvent& event);

  const std::vector<Outage>& outages() const { return outages_; }

 private:
  struct Stream {
    Stamp last;
    std::optional<std::size_t> outage;  // index of the one that lasts
    int said = 0;
  };
  void fall_silent(const std::string& sensor, Stream& stream);
  void come_back(const std::string& sensor, Stream& stream, Stamp now);

  std::map<std::string, Stream> streams_;
  std::optional<Stamp> first_;
  std::vector<Outage> outages_;
};

}  // namespace apvi::pipeline
