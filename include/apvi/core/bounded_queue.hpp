// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <stop_token>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi {

/// Behavior of a full queue: `block` makes the producer wait (offline: no data are lost),
/// `drop_oldest` discards the oldest element (real time).
enum class Overflow { block, drop_oldest };

/// Thread-safe FIFO queue with a fixed capacity. After `close`, queued elements are still
/// delivered; a stop token unblocks waiting calls at once.
template <typename T>
class BoundedQueue {
 public:
  BoundedQueue(std::size_t capacity, Overflow overflow) : capacity_(capacity), overflow_(overflow) {
    APVI_CHECK(capacity > 0);
  }

  /// False when the queue is closed or a stop was requested; the value is then discarded.
  bool push(T value, std::stop_token stop = {}) {
    std::unique_lock lock(mutex_);
    if (overflow_ == Overflow::block) {
      not_full_.wait(lock, stop, [&] { return closed_ || items_.size() < capacity_; });
      if (!closed_ && items_.size() >= capacity_) return false;
    }
    if (closed_ || stop.stop_requested()) return false;
    if (items_.size() >= capacity_) {
      items_.pop_front();
      ++dropped_;
    }
    items_.push_back(std::move(value));
    not_empty_.notify_one();
    return true;
  }

  /// The oldest element; nullopt when the queue is closed and empty, or a stop was requested.
  std::optional<T> pop(std::stop_token stop = {}) {
    std::unique_lock lock(mutex_);
    not_empty_.wait(lock, stop, [&] { return closed_ || !items_.empty(); });
    if (stop.stop_requested() || items_.empty()) return std::nullopt;
    T value = std::move(items_.front());
    items_.pop_front();
    not_full_.notify_one();
    return value;
  }

  /// Rejects further pushes; pops continue until the queue is empty.
  void close() {
    const std::scoped_lock lock(mutex_);
    closed_ = true;
    not_empty_.notify_all();
    not_full_.notify_all();
  }

  bool closed() const {
    const std::scoped_lock lock(mutex_);
    return closed_;
  }
  std::size_t size() const {
    const std::scoped_lock lock(mutex_);
    return items_.size();
  }
  /// Elements discarded by Overflow::drop_oldest so far.
  std::size_t dropped() const {
    const std::scoped_lock lock(mutex_);
    return dropped_;
  }

 private:
  const std::size_t capacity_;
  const Overflow overflow_;
  mutable std::mutex mutex_;
  std::condition_variable_any not_empty_;
  std::condition_variable_any not_full_;
  std::deque<T> items_;
  std::size_t dropped_ = 0;
  bool closed_ = false;
};

}  // namespace apvi
