// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/common/memory_pool.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstdint>
#include <new>

#include "gaussians/device.hpp"

namespace apvi::gaussians {
namespace {

template <typename F>
bool is_out_of_memory_in(F&& f) {
  try {
    f();
  } catch (const c10::Error& error) {
    return is_out_of_memory(error);
  }
  return false;
}

TEST(MemoryPool, FailedAllocationIsAnOutOfMemoryError) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers abort instead";
#endif
  constexpr std::int64_t kMoreThanAddressable = std::int64_t{1} << 60;
  EXPECT_TRUE(is_out_of_memory_in([] { pooled_empty({kMoreThanAddressable}, torch::kByte); }));
}

TEST(MemoryPool, BadAllocIsAnOutOfMemoryError) {
  EXPECT_TRUE(
      is_out_of_memory_in([] { convert_bad_alloc([]() -> int { throw std::bad_alloc(); }); }));
}

TEST(MemoryPool, OtherErrorsAreNotOutOfMemory) {
  EXPECT_FALSE(is_out_of_memory_in([] { TORCH_CHECK(false, "render: sh_degree -1 is negative"); }));
}

}  // namespace
}  // namespace apvi::gaussians
