// SPDX-License-Identifier: BSD-3-Clause
#include "recycler.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <vector>

namespace apvi::splat {
namespace {

constexpr std::size_t kAlignment = 64;
constexpr std::size_t kWorthwhile = std::size_t{1} << 16U;  // [bytes]
constexpr std::size_t kMostWaiting = std::size_t{1} << 30U;
constexpr std::uint64_t kPatience = 128;  // blocks taken in the meantime: some six passes

struct Block {
  void* memory;
  std::size_t size;
  std::uint64_t since;  // as counted by blocks taken
};

class Recycler {
 public:
  Recycler() = default;
  Recycler(const Recycler&) = delete;
  Recycler& operator=(const Recycler&) = delete;
  ~Recycler() {
    for (const Block& block : waiting_) std::free(block.memory);
  }

  /// The smallest block that waits and holds `size`, unless it is twice too large.
  Block take(std::size_t size) {
    const std::lock_guard lock(mutex_);
    ++taken_;
    // What waits is in the order in which it came back.
    while (!waiting_.empty() && waiting_.front().since + kPatience < taken_) drop_oldest();
    auto best = waiting_.end();
    for (auto it = waiting_.begin(); it != waiting_.end(); ++it) {
      if (it->size >= size && it->size / 2 <= size &&
          (best == waiting_.end() || it->size < best->size)) {
        best = it;
      }
    }
    if (best == waiting_.end()) return {std::aligned_alloc(kAlignment, size), size, 0};
    const Block block = *best;
    waiting_.erase(best);
    bytes_ -= block.size;
    return block;
  }

  void give_back(Block block) {
    const std::lock_guard lock(mutex_);
    block.since = taken_;
    waiting_.push_back(block);
    bytes_ += block.size;
    while (bytes_ > kMostWaiting) drop_oldest();
  }

 private:
  void drop_oldest() {
    std::free(waiting_.front().memory);
    bytes_ -= waiting_.front().size;
    waiting_.erase(waiting_.begin());
  }

  std::mutex mutex_;
  std::vector<Block> waiting_;  // the oldest first
  std::size_t bytes_ = 0;
  std::uint64_t taken_ = 0;
};

}  // namespace

torch::Tensor recycled_empty(at::IntArrayRef sizes, const torch::TensorOptions& options) {
  // Tensors share it: one that outlives the program's statics still has a place to go.
  static const auto recycler = std::make_shared<Recycler>();
  const auto bytes =
      static_cast<std::size_t>(c10::multiply_integers(sizes)) * options.dtype().itemsize();
  if (bytes < kWorthwhile) return torch::empty(sizes, options);
  const Block block = recycler->take((bytes + kAlignment - 1) / kAlignment * kAlignment);
  TORCH_CHECK(block.memory != nullptr, "render: no memory for ", bytes >> 20U, " MiB");
  return torch::from_blob(
      block.memory, sizes, [owner = recycler, block](void*) { owner->give_back(block); },
      options.requires_grad(false));
}

}  // namespace apvi::splat
