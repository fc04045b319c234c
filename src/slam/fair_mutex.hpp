// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace apvi::slam {

/// A mutex that is granted in order of arrival, so that a thread that locks it in a loop does not
/// starve the others.
class FairMutex {
 public:
  void lock() {
    std::unique_lock lock(mutex_);
    const std::uint64_t ticket = next_++;
    granted_.wait(lock, [&] { return ticket == serving_; });
  }
  void unlock() {
    {
      const std::scoped_lock lock(mutex_);
      ++serving_;
    }
    granted_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable granted_;
  std::uint64_t next_ = 0;
  std::uint64_t serving_ = 0;
};

}  // namespace apvi::slam
