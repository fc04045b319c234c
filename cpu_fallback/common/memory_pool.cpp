// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/common/memory_pool.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <vector>

namespace apvi::gaussians {
namespace {

constexpr std::size_t kAlignment = 64;
constexpr std::size_t kMinBlockBytes = std::size_t{1} << 16U;  // [bytes]
constexpr std::size_t kMaxPooledBytes = std::size_t{1} << 30U;
constexpr std::uint64_t kMaxAge = 128;  // allocations in the meantime: about six passes

struct Block {
  void* memory;
  std::size_t size;
  std::uint64_t since;  // allocation count when it was returned
};

class MemoryPool {
 public:
  MemoryPool() = default;
  MemoryPool(const MemoryPool&) = delete;
  MemoryPool& operator=(const MemoryPool&) = delete;
  ~MemoryPool() {
    for (const Block& block : free_blocks_) std::free(block.memory);
  }

  /// The smallest pooled block that holds `size`, unless it is more than twice as large.
  Block allocate(std::size_t size) {
    const std::lock_guard lock(mutex_);
    ++allocations_;
    // Pooled blocks are in the order of their return.
    while (!free_blocks_.empty() && free_blocks_.front().since + kMaxAge < allocations_)
      drop_oldest();
    auto best = free_blocks_.end();
    for (auto it = free_blocks_.begin(); it != free_blocks_.end(); ++it) {
      if (it->size >= size && it->size / 2 <= size &&
          (best == free_blocks_.end() || it->size < best->size)) {
        best = it;
      }
    }
    if (best == free_blocks_.end()) return {std::aligned_alloc(kAlignment, size), size, 0};
    const Block block = *best;
    free_blocks_.erase(best);
    bytes_ -= block.size;
    return block;
  }

  void release(Block block) {
    const std::lock_guard lock(mutex_);
    block.since = allocations_;
    free_blocks_.push_back(block);
    bytes_ += block.size;
    while (bytes_ > kMaxPooledBytes) drop_oldest();
  }

 private:
  void drop_oldest() {
    std::free(free_blocks_.front().memory);
    bytes_ -= free_blocks_.front().size;
    free_blocks_.erase(free_blocks_.begin());
  }

  std::mutex mutex_;
  std::vector<Block> free_blocks_;  // oldest first
  std::size_t bytes_ = 0;
  std::uint64_t allocations_ = 0;
};

}  // namespace

torch::Tensor pooled_empty(at::IntArrayRef sizes, const torch::TensorOptions& options) {
  // Shared with the tensors, which may outlive static objects.
  static const auto pool = std::make_shared<MemoryPool>();
  const auto bytes =
      static_cast<std::size_t>(c10::multiply_integers(sizes)) * options.dtype().itemsize();
  if (bytes < kMinBlockBytes) return torch::empty(sizes, options);
  const Block block = pool->allocate((bytes + kAlignment - 1) / kAlignment * kAlignment);
  TORCH_CHECK_WITH(OutOfMemoryError, block.memory != nullptr, "render: cannot allocate ",
                   bytes >> 20U, " MiB");
  return torch::from_blob(
      block.memory, sizes, [owner = pool, block](void*) { owner->release(block); },
      options.requires_grad(false));
}

}  // namespace apvi::gaussians
