// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <exception>
#include <functional>
#include <thread>
#include <utility>

#include "apvi/core/bounded_queue.hpp"

namespace apvi {

/// A thread that calls a function for every element of its input queue, in order. An exception
/// thrown by the function stops the worker; `wait` rethrows it in the caller's thread.
template <typename In>
class Worker {
 public:
  Worker(std::size_t capacity, Overflow overflow, std::function<void(In)> process)
      : queue_(capacity, overflow),
        process_(std::move(process)),
        thread_([this](std::stop_token stop) { loop(stop); }) {}
  ~Worker() { stop(); }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// False once the worker has been stopped or its function has thrown.
  bool push(In value) { return queue_.push(std::move(value)); }

  /// Processes the queued elements, then rethrows the function's exception, if any.
  void wait() {
    queue_.close();
    if (thread_.joinable()) thread_.join();
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
  }

  /// Stops after the current element and discards the queued ones.
  void stop() {
    thread_.request_stop();
    queue_.close();
    if (thread_.joinable()) thread_.join();
  }

  /// Whether it accepts no more elements; if its function has thrown, `wait` rethrows.
  bool closed() const { return queue_.closed(); }
  std::size_t dropped() const { return queue_.dropped(); }
  /// Elements in the queue.
  std::size_t waiting() const { return queue_.size(); }

 private:
  void loop(std::stop_token stop) {
    try {
      while (auto value = queue_.pop(stop)) process_(std::move(*value));
    } catch (...) {
      error_ = std::current_exception();
    }
    queue_.close();  // unblocks a waiting producer
  }

  BoundedQueue<In> queue_;
  std::function<void(In)> process_;
  std::exception_ptr error_;  // written by the thread, read after join
  std::jthread thread_;       // last: joined before the others are destroyed
};

}  // namespace apvi
