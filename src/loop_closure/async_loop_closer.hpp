// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "core/worker.hpp"
#include "loop_closure/correction_log.hpp"
#include "loop_closure/loop_closer.hpp"

namespace apvi::loop_closure {

/// A keyframe to add to the loop closer.
struct LoopInput {
  Keyframe keyframe;
  cv::Mat gray;
  std::vector<std::pair<Stamp, SE3>> moved;  ///< window keyframes with their updated poses
};

/// Where a loop closer runs.
enum class LoopThread {
  none,      ///< on the caller's thread
  blocking,  ///< on a thread of its own; the same result
  skipping,  ///< on a thread of its own that skips images when it is behind
};

/// Runs a loop closer on a thread of its own, or on the caller's.
class AsyncLoopCloser {
 public:
  AsyncLoopCloser(const CloserOptions& options, const CameraModel& camera, LoopThread thread);
  ~AsyncLoopCloser() { stop(); }
  AsyncLoopCloser(const AsyncLoopCloser&) = delete;
  AsyncLoopCloser& operator=(const AsyncLoopCloser&) = delete;

  /// Blocks only if the thread is `blocking` and far behind. Rethrows an exception of the thread.
  void push(LoopInput job);
  /// What was pushed so far and what that has caused, if the options ask for corrections. The log
  /// may outlive this object.
  std::size_t pushed() const { return pushed_; }
  const std::shared_ptr<CorrectionLog>& corrections() const { return corrections_; }
  /// Processes all queued keyframes and publishes the last corrections. Rethrows an exception of
  /// the worker thread.
  void finish();
  /// `LoopCloser::adjust` on the caller's thread, after `finish`; publishes its corrections.
  void adjust(const std::function<void(int iteration)>& progress);
  /// Discards what is queued.
  void stop();

  /// Correction of the newest keyframe; any thread.
  SE3 newest_correction() const;
  /// After `finish` or `stop`.
  const LoopCloser& closer() const { return closer_; }
  /// Time spent on each keyframe that was searched for loops [s]. After `finish` or `stop`.
  const std::vector<double>& seconds() const { return seconds_; }

 private:
  void process(const LoopInput& job);
  void publish(bool changed);

  LoopCloser closer_;
  std::vector<double> seconds_;
  bool skips_images_;
  bool lists_corrections_;
  std::size_t pushed_ = 0;
  std::size_t published_loops_ = 0;
  std::shared_ptr<CorrectionLog> corrections_ = std::make_shared<CorrectionLog>();
  mutable std::mutex mutex_;
  SE3 newest_;                                 // guarded by mutex_
  std::unique_ptr<Worker<LoopInput>> worker_;  // last member: stopped before the members it uses
};

}  // namespace apvi::loop_closure
