// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/correction_log.hpp"

#include <limits>
#include <utility>

namespace apvi::loop_closure {

void CorrectionLog::publish(KeyframeCorrections corrections, std::size_t closures,
                            const std::vector<ClosedLoop>& new_loops) {
  const std::scoped_lock lock(mutex_);
  ++keyframes_;
  closures_ = closures;
  loops_.insert(loops_.end(), new_loops.begin(), new_loops.end());
  if (!closed_ && !corrections.empty()) entries_.push_back({keyframes_, std::move(corrections)});
  published_.notify_all();
}

void CorrectionLog::close() {
  const std::scoped_lock lock(mutex_);
  closed_ = true;
  published_.notify_all();
}

std::vector<KeyframeCorrections> CorrectionLog::take(std::size_t keyframes) {
  std::vector<KeyframeCorrections> all;
  for (; !entries_.empty() && entries_.front().keyframes <= keyframes; entries_.pop_front()) {
    all.push_back(std::move(entries_.front().corrections));
  }
  return all;
}

std::vector<KeyframeCorrections> CorrectionLog::read(std::size_t keyframes, bool wait) {
  std::unique_lock lock(mutex_);
  if (wait) published_.wait(lock, [&] { return closed_ || keyframes_ >= keyframes; });
  return take(keyframes);
}

std::vector<KeyframeCorrections> CorrectionLog::read_all() {
  const std::scoped_lock lock(mutex_);
  return take(std::numeric_limits<std::size_t>::max());
}

std::size_t CorrectionLog::closures() const {
  const std::scoped_lock lock(mutex_);
  return closures_;
}

std::vector<ClosedLoop> CorrectionLog::loops() const {
  const std::scoped_lock lock(mutex_);
  return loops_;
}

}  // namespace apvi::loop_closure
