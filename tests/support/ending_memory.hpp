// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <c10/core/CPUAllocator.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include "apvi/splat/device.hpp"

/// Skips the test on a GPU: it is in the host's memory that tests let LibTorch's end.
#define APVI_NEEDS_MAPS_IN_HOST_MEMORY() \
  if (::apvi::splat::active_device().is_cuda()) GTEST_SKIP() << "maps are in another memory there"

namespace apvi::test {

/// While this lives, LibTorch's memory on the host may end as a device's does: of what it is asked
/// for at a time, at least `kLarge` bytes, some is refused with c10::OutOfMemoryError.
class EndingMemory : public c10::Allocator {
 public:
  static constexpr std::size_t kLarge = 4096;

  EndingMemory() : real_(c10::GetDefaultCPUAllocator()) { c10::SetCPUAllocator(this, kPriority); }
  ~EndingMemory() override { c10::SetCPUAllocator(real_, kPriority); }
  EndingMemory(const EndingMemory&) = delete;
  EndingMemory& operator=(const EndingMemory&) = delete;

  /// How often it was asked so far.
  int asked() const { return asked_; }
  /// From now on `after` requests are granted, then `count` refused.
  void end(int after, int count = 1) {
    asked_ = 0;
    first_ = after;
    last_ = after + count;
  }

  // Which of these LibTorch asks for, and whether it asks to copy, differs by its version: hence no
  // `override`.
  // NOLINTBEGIN(modernize-use-override)
  c10::DataPtr allocate(std::size_t bytes) { return granted(bytes); }
  c10::DataPtr allocate(std::size_t bytes) const { return granted(bytes); }
  void copy_data(void* to, const void* from, std::size_t bytes) const {
    std::memcpy(to, from, bytes);
  }
  // NOLINTEND(modernize-use-override)
  c10::DeleterFnPtr raw_deleter() const override { return real_->raw_deleter(); }

 private:
  c10::DataPtr granted(std::size_t bytes) const {
    if (bytes >= kLarge) {
      const int number = asked_++;
      TORCH_CHECK_WITH(OutOfMemoryError, number < first_ || number >= last_, "no memory left");
    }
    return real_->allocate(bytes);
  }

  static constexpr std::uint8_t kPriority = 255;

  c10::Allocator* real_;
  mutable std::atomic<int> asked_ = 0;
  std::atomic<int> first_ = std::numeric_limits<int>::max();
  std::atomic<int> last_ = std::numeric_limits<int>::max();
};

/// For tests in which it ends: one thread, so that the same is asked for every time.
class EndingMemoryTest : public testing::Test {
 protected:
  void SetUp() override {
    APVI_NEEDS_MAPS_IN_HOST_MEMORY();
    torch::set_num_threads(1);
  }
  void TearDown() override { torch::set_num_threads(threads_); }

 private:
  int threads_ = torch::get_num_threads();
};

}  // namespace apvi::test
