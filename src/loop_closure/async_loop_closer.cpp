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
  if (!worker_) return process(job);
  if (skips_images_ && worker_->waiting() >= kMaxQueuedImages) job.gray = cv::Mat();
  if (!worker_->push(std::move(job)))
    worker_->wait();  // the worker has stopped: rethrow its exception
}

void AsyncLoopCloser::process(const LoopInput& job) {
  const Stopwatch watch;
  for (const auto& [stamp, pose] : job.moved) closer_.update_pose(stamp, pose);
  publish(closer_.add(job.keyframe, job.gray));
  closures_ = closer_.closures();
  if (closer_.searched()) seconds_.push_back(watch.seconds());
}

void AsyncLoopCloser::publish(bool changed) {
  if (!changed) return;
  std::vector<KeyframeCorrection> corrections;
  if (lists_corrections_) corrections = closer_.changed_corrections();
  const std::lock_guard lock(mutex_);
  newest_ = closer_.newest_correction();
  if (lists_corrections_) corrections_.push_back(std::move(corrections));
}

std::vector<KeyframeCorrection> AsyncLoopCloser::pop_corrections() {
  const std::lock_guard lock(mutex_);
  if (corrections_.empty()) return {};
  auto first = std::move(corrections_.front());
  corrections_.pop_front();
  return first;
}

SE3 AsyncLoopCloser::newest_correction() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

void AsyncLoopCloser::finish() {
  if (worker_) worker_->wait();
  publish(closer_.finish());
}

void AsyncLoopCloser::stop() {
  if (worker_) worker_->stop();
}

}  // namespace apvi::loop_closure
