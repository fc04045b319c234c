// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "apvi/core/stamp.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Passes only usable samples of one sensor: finite numbers at strictly increasing stamps. A single
/// stamp farther than `max_jump` from its neighbors is broken and dropped; a persistent forward
/// jump is a gap and is kept; after a persistent backward jump all samples are out of order. To
/// distinguish these cases, a sample after a jump is held until the next one.
class StreamCleaner {
 public:
  /// `where` returns the location of the sample being pushed; called only when a sample is held or
  /// dropped.
  StreamCleaner(std::string sensor, Duration max_jump, StreamReport& report,
                std::function<std::string()> where);

  /// Takes the next sample; clean ones are appended to `ready`.
  void push(SensorEvent event);
  /// Counts a dropped sample; logs the first one for each reason.
  void drop(DropReason reason) { drop(reason, where_()); }
  /// The same for a malformed sample: the kind of problem, and the text at fault. Logs the first of
  /// each kind.
  void drop_malformed(const std::pair<std::string, std::string>& problem);
  /// The first sample is known to have a right stamp: it is not held.
  void trust_first() { trust_first_ = true; }
  /// Forgets all samples, also those that are ready.
  void restart();
  /// The sensor has no more samples.
  void finish();

  std::deque<SensorEvent> ready;

 private:
  struct PendingSample {
    SensorEvent event;
    std::string where;
  };

  void drop(DropReason reason, const std::string& where);
  void log_counts() const;
  void push_first(SensorEvent event);
  void push_after_jump(SensorEvent event);
  void push_regular(SensorEvent event);
  void accept(SensorEvent event);
  bool within_max_jump(Stamp a, Stamp b) const;
  void resolve_jump_back(bool persistent);

  std::string sensor_;
  Duration max_jump_;
  StreamReport* report_;
  std::function<std::string()> where_;
  std::optional<Stamp> last_;
  std::deque<PendingSample> pending_;     // held until a later sample confirms their stamps
  std::optional<std::string> jump_back_;  // location of a sample far in the past, single or not
  bool jump_back_persists_ = false;
  bool trust_first_ = false;
  std::map<std::string, std::size_t> malformed_;  // counts by kind of problem
};

}  // namespace apvi::io
