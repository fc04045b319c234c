// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <exception>
#include <functional>
#include <thread>
#include <utility>

#include "apvi/core/bounded_queue.hpp"

namespace apvi {

/// A thread that calls one function for every element of its input queue, in order. An exception of
/// the function ends the work, never the process: `wait` throws it in the caller's thread.
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

  /// Soft stop: finishes what is queued, then rethrows what the function threw, if it did.
  void wait() {
    queue_.close();
    if (thread_.joinable()) thread_.join();
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
  }

  /// Hard stop: abandons what is queued.
  void stop() {
    thread_.request_stop();
    queue_.close();
    if (thread_.joinable()) thread_.join();
  }

  /// Whether it takes nothing more; `wait` says why, when its function has thrown.
  bool ended() const { return queue_.closed(); }
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
    queue_.close();  // a producer that waits for room must not wait for ever
  }

  BoundedQueue<In> queue_;
  std::function<void(In)> process_;
  std::exception_ptr error_;  // written by the thread, read after join
  std::jthread thread_;       // last: it must end before the rest is destroyed
};

}  // namespace apvi
