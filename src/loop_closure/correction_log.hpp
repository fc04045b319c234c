// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"

namespace apvi::loop_closure {

/// Correction of the pose of a keyframe.
struct KeyframeCorrection {
  Stamp stamp;
  SE3 T_after_before;  ///< left-multiplies the last reported camera pose
};

/// Of one optimization, in order of time. Keyframes that are not listed do not move, except those
/// after the last one, which move with it.
using KeyframeCorrections = std::vector<KeyframeCorrection>;

/// The keyframes that a loop closure joins.
struct ClosedLoop {
  Stamp from;  ///< the earlier one
  Stamp to;
};

/// Corrections on their way from the thread of the pose graph to that of the map. They are numbered
/// by the keyframe that caused them, so that a reader can have them in the same order in every run.
class CorrectionLog {
 public:
  /// After every keyframe, and once after the last one; no corrections if nothing has moved.
  /// `closures`: accepted loop closures so far. `new_loops`: those since the last call.
  void publish(KeyframeCorrections corrections, std::size_t closures,
               const std::vector<ClosedLoop>& new_loops = {});
  /// By writer or reader: no reader waits anymore, and later corrections are not kept.
  void close();

  /// What the first `keyframes` keyframes have caused and was not read before, oldest first, each
  /// relative to the poses after the one before. `wait`: until these keyframes have been processed.
  std::vector<KeyframeCorrections> read(std::size_t keyframes, bool wait);
  /// Everything that was not read before; does not wait.
  std::vector<KeyframeCorrections> read_all();
  /// Accepted loop closures.
  std::size_t closures() const;
  std::vector<ClosedLoop> loops() const;

 private:
  struct Entry {
    std::size_t keyframes = 0;  ///< processed when it was published
    KeyframeCorrections corrections;
  };

  std::vector<KeyframeCorrections> take(std::size_t keyframes);

  mutable std::mutex mutex_;
  std::condition_variable published_;
  std::deque<Entry> entries_;
  std::size_t keyframes_ = 0;  ///< processed
  std::size_t closures_ = 0;
  std::vector<ClosedLoop> loops_;
  bool closed_ = false;
};

}  // namespace apvi::loop_closure
