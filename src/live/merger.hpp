// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <map>
#include <string>

#include "apvi/sensors/samples.hpp"

namespace apvi::live {

struct MergerOptions {
  double max_wait_s = 0.5;  ///< after its arrival a sample waits no longer for others [s]
  double silent_s = 1.0;    ///< a stream without a sample for so long is not waited for [s]
};

/// Brings the samples of all sensors into the order of their stamps while they arrive.
///
/// A sample waits until no older one is expected: each other stream has a newer sample, or is
/// silent, or has had the time that its samples took to arrive in the last seconds. A sample that
/// comes after a newer one was delivered is late: it is dropped and counted. Not thread-safe.
class Merger {
 public:
  using Deliver = std::function<void(SensorEvent, Stamp arrival)>;

  Merger(const MergerOptions& options, Deliver deliver)
      : options_(options), deliver_(std::move(deliver)) {}

  /// Takes a sample; those of one sensor in order.
  void add(SensorEvent event, Stamp arrival);
  /// Delivers what is due at this time of the host. Called often, also while nothing arrives.
  void advance(Stamp now);
  /// Delivers everything.
  void finish();

  /// Dropped samples by stream: "imu", "dvl", "camera0" and so on.
  const std::map<std::string, std::size_t>& late() const { return late_; }

 private:
  /// How late samples are, at most, in the last five to ten seconds.
  struct Lateness {
    std::array<Duration, 2> largest{};  // of the current and the previous period
    Stamp since;
    void add(Duration lateness, Stamp now);
    Duration expected() const;
  };
  struct Stream {
    Stamp newest = Stamp::min();
    Stamp last_arrival;
    Lateness lateness;
  };
  struct Waiting {
    SensorEvent event;
    Stamp arrival;
  };

  bool is_due(Stamp stamp, const Waiting& waiting, Stamp now) const;
  void deliver_first();

  MergerOptions options_;
  Deliver deliver_;
  std::map<std::string, Stream> streams_;
  std::multimap<Stamp, Waiting> waiting_;
  Stamp delivered_ = Stamp::min();
  std::map<std::string, std::size_t> late_;
};

}  // namespace apvi::live
