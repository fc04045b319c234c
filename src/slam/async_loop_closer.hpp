// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "core/worker.hpp"
#include "loop_closure/loop_closer.hpp"

namespace apvi::slam {

/// A keyframe to add to the loop closer.
struct LoopInput {
  Stamp stamp;
  SE3 T_world_camera;
  cv::Mat gray;
  std::vector<std::pair<Stamp, SE3>> moved;  ///< window keyframes with their updated poses
};

/// Runs the loop closer on a worker thread, or on the caller's thread for deterministic results.
class AsyncLoopCloser {
 public:
  AsyncLoopCloser(const loop_closure::LoopOptions& options, const loop_closure::Pinhole& camera,
                  bool threaded);

  /// Never blocks: when too many images are queued, the new keyframe is added without its image.
  void push(LoopInput job);
  /// Pose corrections of the oldest unread loop closure; empty when there is none.
  std::vector<loop_closure::KeyframeCorrection> pop_corrections();
  /// Processes all queued keyframes and publishes the last corrections. Rethrows an exception of
  /// the worker thread.
  void finish();
  std::size_t closures() const { return closures_; }

 private:
  void process(const LoopInput& job);
  void publish(std::vector<loop_closure::KeyframeCorrection> corrections);

  loop_closure::LoopCloser closer_;
  std::atomic<std::size_t> closures_ = 0;
  std::mutex mutex_;
  std::deque<std::vector<loop_closure::KeyframeCorrection>> corrections_;  // guarded by mutex_
  std::unique_ptr<Worker<LoopInput>> worker_;  // last member: stopped before the members it uses
};

}  // namespace apvi::slam
