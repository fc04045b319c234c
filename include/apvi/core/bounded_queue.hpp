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

/// What a full queue does with a new element: makes the producer wait (replay: nothing is lost) or
/// lets go of the oldest one (real time: the newest counts).
enum class Overflow { block, drop_oldest };

/// A first-in first-out queue between threads with a fixed capacity. `close` is the soft stop: what
/// is queued is still delivered. A stop token is the hard stop: waiting ends at once.
template <typename T>
class BoundedQueue {
 public:
  BoundedQueue(std::size_t capacity, Overflow overflow) : capacity_(capacity), overflow_(overflow) {
    APVI_CHECK(capacity > 0);
  }

  /// False when the queue is closed or a stop was asked for; the value is dropped then.
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

  /// The oldest element; nothing when the queue is closed and empty, or a stop was asked for.
  std::optional<T> pop(std::stop_token stop = {}) {
    std::unique_lock lock(mutex_);
    not_empty_.wait(lock, stop, [&] { return closed_ || !items_.empty(); });
    if (stop.stop_requested() || items_.empty()) return std::nullopt;
    T value = std::move(items_.front());
    items_.pop_front();
    not_full_.notify_one();
    return value;
  }

  /// No more pushes; pops go on until the queue is empty.
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
  /// Elements let go of by Overflow::drop_oldest so far.
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
