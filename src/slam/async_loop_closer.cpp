// SPDX-License-Identifier: BSD-3-Clause
#include "slam/async_loop_closer.hpp"

namespace apvi::slam {
namespace {

constexpr std::size_t kQueueSize = 4096;  // keyframes; without an image they cost almost nothing
constexpr std::size_t kMaxQueuedImages = 3;

}  // namespace

AsyncLoopCloser::AsyncLoopCloser(const loop_closure::LoopOptions& options,
                                 const loop_closure::Pinhole& camera, bool threaded)
    : closer_(options, camera) {
  if (!threaded) return;
  worker_ = std::make_unique<Worker<LoopInput>>(kQueueSize, Overflow::block,
                                                [this](const LoopInput& job) { process(job); });
}

void AsyncLoopCloser::push(LoopInput job) {
  if (!worker_) return process(job);
  if (worker_->waiting() >= kMaxQueuedImages) job.gray = cv::Mat();
  if (!worker_->push(std::move(job)))
    worker_->wait();  // the worker has stopped: rethrow its exception
}

void AsyncLoopCloser::process(const LoopInput& job) {
  for (const auto& [stamp, pose] : job.moved) closer_.update_pose(stamp, pose);
  publish(closer_.add(job.stamp, job.gray, job.T_world_camera));
  closures_ = closer_.closures();
}

void AsyncLoopCloser::publish(std::vector<loop_closure::KeyframeCorrection> corrections) {
  if (corrections.empty()) return;
  const std::lock_guard lock(mutex_);
  corrections_.push_back(std::move(corrections));
}

std::vector<loop_closure::KeyframeCorrection> AsyncLoopCloser::pop_corrections() {
  const std::lock_guard lock(mutex_);
  if (corrections_.empty()) return {};
  auto first = std::move(corrections_.front());
  corrections_.pop_front();
  return first;
}

void AsyncLoopCloser::finish() {
  if (worker_) worker_->wait();
  publish(closer_.flush());
}

}  // namespace apvi::slam
