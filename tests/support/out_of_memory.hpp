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

#include "gaussians/device.hpp"

/// Skips the test on a GPU: only host allocations can be made to fail.
#define APVI_SKIP_ON_GPU()                          \
  if (::apvi::gaussians::active_device().is_cuda()) \
  GTEST_SKIP() << "map tensors are not in host memory"

namespace apvi::test {

/// Simulates device out-of-memory errors on the host: while an instance exists, selected LibTorch
/// allocations of at least `kLarge` bytes throw c10::OutOfMemoryError.
class OutOfMemoryAllocator : public c10::Allocator {
 public:
  static constexpr std::size_t kLarge = 4096;

  OutOfMemoryAllocator() : real_(c10::GetDefaultCPUAllocator()) {
    c10::SetCPUAllocator(this, kPriority);
  }
  ~OutOfMemoryAllocator() override { c10::SetCPUAllocator(real_, kPriority); }
  OutOfMemoryAllocator(const OutOfMemoryAllocator&) = delete;
  OutOfMemoryAllocator& operator=(const OutOfMemoryAllocator&) = delete;

  /// Number of large allocations requested so far.
  int request_count() const { return request_count_; }
  /// The next `after` large allocations succeed, then `count` fail.
  void fail_after(int after, int count = 1) {
    request_count_ = 0;
    first_ = after;
    last_ = after + count;
  }

  // The virtual functions differ between LibTorch versions, hence no `override`.
  // NOLINTBEGIN(modernize-use-override)
  c10::DataPtr allocate(std::size_t bytes) { return checked_allocate(bytes); }
  c10::DataPtr allocate(std::size_t bytes) const { return checked_allocate(bytes); }
  void copy_data(void* to, const void* from, std::size_t bytes) const {
    std::memcpy(to, from, bytes);
  }
  // NOLINTEND(modernize-use-override)
  c10::DeleterFnPtr raw_deleter() const override { return real_->raw_deleter(); }

 private:
  c10::DataPtr checked_allocate(std::size_t bytes) const {
    if (bytes >= kLarge) {
      const int number = request_count_++;
      TORCH_CHECK_WITH(OutOfMemoryError, number < first_ || number >= last_, "out of memory");
    }
    return real_->allocate(bytes);
  }

  static constexpr std::uint8_t kPriority = 255;

  c10::Allocator* real_;
  mutable std::atomic<int> request_count_ = 0;
  std::atomic<int> first_ = std::numeric_limits<int>::max();
  std::atomic<int> last_ = std::numeric_limits<int>::max();
};

/// Fixture that uses one thread, so that allocations are reproducible.
class OutOfMemoryTest : public testing::Test {
 protected:
  void SetUp() override {
    APVI_SKIP_ON_GPU();
    torch::set_num_threads(1);
  }
  void TearDown() override { torch::set_num_threads(threads_); }

 private:
  int threads_ = torch::get_num_threads();
};

}  // namespace apvi::test
