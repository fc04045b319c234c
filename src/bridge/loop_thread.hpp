// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "apvi/core/worker.hpp"
#include "apvi/loop/loop_closer.hpp"

namespace apvi::bridge {

/// A keyframe for the loop closer.
struct LoopJob {
  Stamp stamp;
  SE3 T_world_camera;
  cv::Mat grey;
  std::vector<std::pair<Stamp, SE3>> moved;  ///< keyframes that odometry has elsewhere now
};

/// A loop closer on a thread of its own, or on the caller's, which is the same every time.
class LoopThread {
 public:
  LoopThread(const loop::LoopOptions& options, const loop::Pinhole& camera, bool threaded);

  /// Never waits: when many pictures wait, the newest is not looked at.
  void take(LoopJob job);
  /// What one closure has changed, in order; empty when there is nothing new.
  std::vector<loop::Relocation> next();
  /// Everything taken is worked in, and the last is told. Throws what the thread has thrown.
  void finish();
  std::size_t closures() const { return closures_; }

 private:
  void process(const LoopJob& job);
  void tell(std::vector<loop::Relocation> relocations);

  loop::LoopCloser closer_;
  std::atomic<std::size_t> closures_ = 0;
  std::mutex mutex_;
  std::deque<std::vector<loop::Relocation>> found_;  // under the mutex
  std::unique_ptr<Worker<LoopJob>> worker_;          // last: ends before what it uses
};

}  // namespace apvi::bridge
