// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

#include "core/stopwatch.hpp"

namespace apvi::slam {

/// Divides the time of the mapping thread between new keyframes and optimization.
///
/// In real time both get a share while frames are queued, and frames are lost instead: a map that
/// only takes in keyframes never improves. Otherwise every keyframe gets a fixed number of steps.
/// One thread measures and asks; `finish` may be called from another.
class MappingScheduler {
 public:
  struct Options {
    bool realtime = false;
    int steps_per_keyframe = 30;      ///< when not in real time
    double training_fraction = 0.5;   ///< of the busy time, while frames are queued
    double max_depth_fraction = 0.3;  ///< of the busy time, while frames are queued
    double max_final_s = 1.0;         ///< for what is queued when the recording ends
    int steps_per_flushed_keyframe = 100;
    std::size_t max_queue_for_medium_fit = 4;  ///< with more, some would be lost during the fit
  };

  explicit MappingScheduler(const Options& options) : options_(options) {}

  /// Measures work: taking in a keyframe, or an optimization step.
  template <typename Work>
  auto measure_keyframe(const Work& work) {
    return measure(keyframes_s_, work);
  }
  template <typename Work>
  auto measure_step(const Work& work) {
    return measure(training_s_, work);
  }

  /// The recording has ended: what is begun from now on is late.
  void finish() {
    since_finish_.reset();
    finishing_ = true;
  }

  /// Whether another step may follow `steps_done` steps for the present keyframe.
  bool may_step(int steps_done, std::size_t queued) const;
  /// Steps for an outage without frames, at the pace of `keyframes` in `mapped_s` before it. None
  /// in real time, which does not need frames to go on.
  int outage_steps(double outage_s, double mapped_s, double keyframes) const;
  /// `depth_s`: time of depth estimation so far [s].
  bool should_skip_depth(std::size_t queued, double depth_s) const;
  bool should_skip_medium_fit(std::size_t queued) const {
    return queued > options_.max_queue_for_medium_fit;
  }
  /// Steps for `keyframes` whose depth is estimated last, out of `accepted` keyframes and
  /// `iterations` steps and `depth_s` of depth estimation so far; 0 when there is no time left for
  /// them.
  int flush_steps(int keyframes, double accepted, double iterations, double depth_s) const;

  double training_s() const { return training_s_; }

 private:
  template <typename Work>
  auto measure(double& seconds, const Work& work) {
    const TimedScope scope(seconds);
    return work();
  }
  double busy_s() const { return keyframes_s_ + training_s_; }

  Options options_;
  double keyframes_s_ = 0.0;
  double training_s_ = 0.0;
  Stopwatch since_finish_;  // written before finishing_ is
  std::atomic<bool> finishing_ = false;
};

}  // namespace apvi::slam
