// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <functional>
#include <optional>
#include <string>

#include "apvi/core/stamp.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Lets through what an estimator can use of one sensor's samples: finite numbers at strictly
/// increasing stamps. A single stamp that lies farther than `max_jump` from its neighbours is
/// broken and dropped; a jump forward that stays is a gap in the recording and kept; after a jump
/// back that stays everything is out of order. To tell these apart a sample behind a jump waits for
/// the next.
class StreamCleaner {
 public:
  /// `where` names the place of the sample being pushed; asked only when a sample is held or
  /// dropped.
  StreamCleaner(std::string sensor, Duration max_jump, StreamReport& report,
                std::function<std::string()> where);

  /// Takes the next sample; clean ones are appended to `ready`.
  void push(SensorEvent event);
  /// Counts a sample and says so in the log the first time it happens for this reason.
  void drop(DropReason reason) { drop(reason, where_()); }
  /// The sensor has no more samples.
  void finish();

  std::deque<SensorEvent> ready;

 private:
  struct Held {
    SensorEvent event;
    std::string where;
  };

  void drop(DropReason reason, const std::string& where);
  void push_first(SensorEvent event);
  void push_after_jump(SensorEvent event);
  void push_regular(SensorEvent event);
  void accept(SensorEvent event);
  bool near(Stamp a, Stamp b) const;
  void settle_jump_back(bool persistent);

  std::string sensor_;
  Duration max_jump_;
  StreamReport* report_;
  std::function<std::string()> where_;
  std::optional<Stamp> last_;
  std::deque<Held> held_;            // waiting for a sample that says whether their stamps are good
  std::optional<std::string> back_;  // place of a sample far in the past, single or not
  bool back_persists_ = false;
};

}  // namespace apvi::io
