// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/async_loop_closer.hpp"

#include "core/stopwatch.hpp"

namespace apvi::loop_closure {
namespace {

constexpr std::size_t kQueueSize = 4096;  // keyframes; without an image they cost almost nothing
constexpr std::size_t kMaxQueuedImages = 3;
constexpr std::size_t kBlockingQueueSize = 16;  // keyframes with their images

}  // namespace

AsyncLoopCloser::AsyncLoopCloser(const CloserOptions& options, const CameraModel& camera,
                                 LoopThread thread)
    : closer_(options, camera),
      skips_images_(thread == LoopThread::skipping),
      lists_corrections_(options.lists_corrections) {
  if (thread == LoopThread::none) return;
  worker_ = std::make_unique<Worker<LoopInput>>(skips_images_ ? kQueueSize : kBlockingQueueSize,
                                                Overflow::block,
                                                [this](const LoopInput& job) { process(job); });
}

void AsyncLoopCloser::push(LoopInput job) {
  ++pushed_;
  if (!worker_) return process(job);
  if (skips_images_ && worker_->waiting() >= kMaxQueuedImages) job.gray = cv::Mat();
  if (!worker_->push(std::move(job)))
    worker_->wait();  // the worker has stopped: rethrow its exception
}

// A reader of the corrections must not wait for keyframes that are never processed.
void AsyncLoopCloser::process(const LoopInput& job) {
  try {
    const Stopwatch watch;
    for (const auto& [stamp, pose] : job.moved) closer_.update_pose(stamp, pose);
    publish(closer_.add(job.keyframe, job.gray));
    if (closer_.searched()) seconds_.push_back(watch.seconds());
  } catch (...) {
    corrections_->close();
    throw;
  }
}

void AsyncLoopCloser::publish(bool changed) {
  if (changed) {
    const std::scoped_lock lock(mutex_);
    newest_ = closer_.newest_correction();
  }
  KeyframeCorrections corrections;
  if (changed && lists_corrections_) corrections = closer_.changed_corrections();
  const std::vector<ClosedLoop> loops = closer_.loops(published_loops_);
  published_loops_ += loops.size();
  corrections_->publish(std::move(corrections), closer_.closures(), loops);
}

SE3 AsyncLoopCloser::newest_correction() const {
  const std::scoped_lock lock(mutex_);
  return newest_;
}

void AsyncLoopCloser::finish() {
  if (worker_) worker_->wait();
  publish(closer_.finish());
}

void AsyncLoopCloser::adjust(const std::function<void(int iteration)>& progress) {
  publish(closer_.adjust(progress));
}

void AsyncLoopCloser::stop() {
  corrections_->close();
  if (worker_) worker_->stop();
}

}  // namespace apvi::loop_closure
