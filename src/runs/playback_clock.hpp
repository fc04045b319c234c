// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>

#include "apvi/core/stamp.hpp"
#include "core/stopwatch.hpp"

namespace apvi::runs {

/// Paces the samples of a recording in real time. A pause in the recording is not waited for.
class PlaybackClock {
 public:
  /// `rate`: speed relative to the recording. A longer step than `max_step_s` between samples [s]
  /// is skipped; the first one is logged.
  PlaybackClock(double rate, double max_step_s) : rate_(rate), max_step_s_(max_step_s) {}

  /// Waits until the sample is due. Returns early when `interrupted`, which is polled.
  void wait(Stamp stamp, const std::function<bool()>& interrupted);

 private:
  double rate_;
  double max_step_s_;
  Stopwatch watch_;
  std::optional<Stamp> origin_;  // of the recording, moved by what was skipped
  Stamp last_;
  int skipped_ = 0;
};

}  // namespace apvi::runs
