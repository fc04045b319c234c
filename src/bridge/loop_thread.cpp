// SPDX-License-Identifier: BSD-3-Clause
#include "loop_thread.hpp"

namespace apvi::bridge {
namespace {

constexpr std::size_t kQueue = 4096;  // keyframes: without pictures they are done with at once
constexpr std::size_t kBusy = 3;

}  // namespace

LoopThread::LoopThread(const loop::LoopOptions& options, const loop::Pinhole& camera, bool threaded)
    : closer_(options, camera) {
  if (!threaded) return;
  worker_ = std::make_unique<Worker<LoopJob>>(kQueue, Overflow::block,
                                              [this](const LoopJob& job) { process(job); });
}

void LoopThread::take(LoopJob job) {
  if (!worker_) return process(job);
  if (worker_->waiting() >= kBusy) job.grey = cv::Mat();
  if (!worker_->push(std::move(job))) worker_->wait();  // it has ended: throws why
}

void LoopThread::process(const LoopJob& job) {
  for (const auto& [stamp, pose] : job.moved) closer_.move(stamp, pose);
  tell(closer_.add(job.stamp, job.grey, job.T_world_camera));
  closures_ = closer_.closures();
}

void LoopThread::tell(std::vector<loop::Relocation> relocations) {
  if (relocations.empty()) return;
  const std::lock_guard lock(mutex_);
  found_.push_back(std::move(relocations));
}

std::vector<loop::Relocation> LoopThread::next() {
  const std::lock_guard lock(mutex_);
  if (found_.empty()) return {};
  auto first = std::move(found_.front());
  found_.pop_front();
  return first;
}

void LoopThread::finish() {
  if (worker_) worker_->wait();
  tell(closer_.settle());
}

}  // namespace apvi::bridge
