// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cub/block/block_scan.cuh>

#include <algorithm>
#include <cstdint>

#include "kernels/common/warp.cuh"

/// Stable least-significant-digit radix sort of pairs, one pass per digit, with decoupled look-back
/// between blocks (Adinets and Merrill, "Onesweep: a faster least significant digit radix sort for
/// GPUs", 2022). Tuned for 10^5 to 10^7 pairs: the number of pairs is known on the device only, the
/// states of all passes are cleared once, and a block looks back at many others at a time.
namespace apvi::gaussians::cuda {

inline constexpr int kSortThreads = 512;
/// Pairs per thread and per block, limited by shared memory.
template <int kBits>
inline constexpr int kSortItems = kBits > 8 ? 6 : 8;
template <int kBits>
inline constexpr std::uint32_t kSortPairs = kSortThreads* kSortItems<kBits>;
inline constexpr int kSortWarps = kSortThreads / kWarp;
inline constexpr int kMaxPasses = 4;

/// Zero-initialized words.
struct SortState {
  std::uint32_t* counts;   ///< [passes,digits] histogram; then its exclusive sums
  std::uint32_t* tickets;  ///< [passes + 1] blocks started per pass; last: blocks of the histogram
                           ///< that finished
  std::uint32_t* blocks;   ///< [passes,blocks,digits] block counts or inclusive prefixes
};
template <int kBits>
std::uint32_t sort_state_words(std::uint32_t capacity, int passes) {
  const std::uint32_t blocks = (capacity + kSortPairs<kBits> - 1) / kSortPairs<kBits>;
  return (blocks + 1) * passes * (1U << kBits) + passes + 1;
}
template <int kBits>
SortState cut_sort_state(std::uint32_t* words, int passes) {
  std::uint32_t* const tickets = words + passes * (1 << kBits);
  return {words, tickets, tickets + passes + 1};
}

/// Arrays of one pass, with room for `capacity` pairs.
template <typename Key>
struct SortPass {
  const Key* keys;
  const std::uint32_t* values;  ///< null: 0, 1, ...
  Key* sorted_keys;             ///< null: not needed
  std::uint32_t* sorted_values;
  int pass;
};

template <int kBits, typename Key>
__device__ inline std::uint32_t digit_of(Key key, int pass) {
  return static_cast<std::uint32_t>(key) >> (pass * kBits) & ((1U << kBits) - 1);
}

/// Exclusive prefix sum of the histogram of a pass, by one warp.
template <int kBits>
__device__ inline void sum_counts(std::uint32_t* counts) {
  constexpr int kOwn = (1 << kBits) / kWarp;
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  std::uint32_t own[kOwn];
  std::uint32_t sum = 0;
  for (int k = 0; k < kOwn; ++k) {
    own[k] = __ldcg(counts + lane * kOwn + k);
    sum += own[k];
  }
  std::uint32_t before = sum;
  for (int by = 1; by < kWarp; by *= 2) {
    const std::uint32_t other = __shfl_up_sync(kAllLanes, before, by);
    if (lane >= by) before += other;
  }
  before -= sum;
  for (int k = 0; k < kOwn; ++k) {
    counts[lane * kOwn + k] = before;
    before += own[k];
  }
}

/// Digit histograms of all passes and their prefix sums.
template <int kBits, typename Key, typename Count>
__global__ void __launch_bounds__(kSortThreads)
    count_digits_kernel(const Key* keys, Count count, int passes, SortState state) {
  constexpr int kDigits = 1 << kBits;
  __shared__ std::uint32_t local[kMaxPasses * kDigits];
  __shared__ bool last;
  for (int k = static_cast<int>(threadIdx.x); k < passes * kDigits; k += kSortThreads) local[k] = 0;
  __syncthreads();
  const std::uint32_t n = count();
  constexpr std::uint32_t kAtOnce = 4;
  const std::uint32_t stride = gridDim.x * kSortThreads;
  for (std::uint32_t i = blockIdx.x * kSortThreads + threadIdx.x; i < n; i += kAtOnce * stride) {
    Key own[kAtOnce];
#pragma unroll
    for (std::uint32_t k = 0; k < kAtOnce; ++k) {
      own[k] = i + k * stride < n ? keys[i + k * stride] : Key{};
    }
#pragma unroll
    for (std::uint32_t k = 0; k < kAtOnce; ++k) {
      if (i + k * stride >= n) break;
      for (int pass = 0; pass < passes; ++pass) {
        atomicAdd(local + pass * kDigits + digit_of<kBits>(own[k], pass), 1U);
      }
    }
  }
  __syncthreads();
  for (int k = static_cast<int>(threadIdx.x); k < passes * kDigits; k += kSortThreads) {
    if (local[k] != 0) atomicAdd(state.counts + k, local[k]);
  }
  __threadfence();
  __syncthreads();
  if (threadIdx.x == 0) last = atomicAdd(state.tickets + passes, 1U) == gridDim.x - 1;
  __syncthreads();
  if (!last) return;
  __threadfence();
  const int pass = static_cast<int>(threadIdx.x) / kWarp;
  if (pass < passes) sum_counts<kBits>(state.counts + pass * kDigits);
}

inline constexpr std::uint32_t kSortOwn = 1U << 30U;     // the count of the block alone
inline constexpr std::uint32_t kSortPrefix = 1U << 31U;  // the inclusive prefix
inline constexpr std::uint32_t kSortValue = kSortOwn - 1;

/// Number of keys with a digit in the blocks before; `states` are those of the digit, `stride`
/// apart.
__device__ inline std::uint32_t look_back(volatile std::uint32_t* states, int stride,
                                          std::uint32_t block) {
  constexpr int kAtOnce = 16;
  std::uint32_t before = 0;
  for (int at = static_cast<int>(block) - 1; at >= 0; at -= kAtOnce) {
    std::uint32_t seen[kAtOnce];
#pragma unroll
    for (int k = 0; k < kAtOnce; ++k) {
      seen[k] = kSortPrefix;
      if (at >= k) seen[k] = states[(at - k) * stride];
    }
#pragma unroll
    for (int k = 0; k < kAtOnce; ++k) {
      while ((seen[k] & (kSortOwn | kSortPrefix)) == 0) seen[k] = states[(at - k) * stride];
      before += seen[k] & kSortValue;
      if ((seen[k] & kSortPrefix) != 0) return before;
    }
  }
  return before;
}

template <int kBits, typename Key>
struct SortShared {
  static constexpr int kDigits = 1 << kBits;
  typename cub::BlockScan<std::uint32_t, kSortThreads>::TempStorage scan;
  std::uint16_t counts[kSortWarps][kDigits];  // then: counts of the warps before
  std::uint32_t first[kDigits];               // first sorted pair of a digit in the block
  std::uint32_t shift[kDigits];               // offset from there to the output
  Key keys[kSortPairs<kBits>];
  std::uint32_t values[kSortPairs<kBits>];
  std::uint32_t block;
};

/// Rank of each key of a thread among the keys of its warp with the same digit.
template <int kBits, typename Key>
__device__ inline void rank_keys(const Key (&keys)[kSortItems<kBits>],
                                 const bool (&valid)[kSortItems<kBits>], int pass,
                                 std::uint16_t* counts, std::uint32_t (&ranks)[kSortItems<kBits>]) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
#pragma unroll
  for (int k = 0; k < kSortItems<kBits>; ++k) {
    const std::uint32_t digit = digit_of<kBits>(keys[k], pass);
    const unsigned same = __match_any_sync(kAllLanes, valid[k] ? digit : 1U << kBits);
    const int leader = __ffs(static_cast<int>(same)) - 1;
    std::uint32_t before = 0;
    if (lane == leader && valid[k]) {
      before = counts[digit];
      counts[digit] = static_cast<std::uint16_t>(before + __popc(same));
    }
    __syncwarp();
    ranks[k] = __shfl_sync(kAllLanes, before, leader) + __popc(same & ((1U << lane) - 1));
  }
}

/// Start of the block's keys of each digit, in the block and in the output.
template <int kBits, typename Key>
__device__ inline void place_digits(SortShared<kBits, Key>& shared, const SortState& state,
                                    int pass) {
  constexpr int kDigits = 1 << kBits;
  const auto digit = static_cast<int>(threadIdx.x);
  const bool has_digit = digit < kDigits;
  std::uint32_t own = 0;
  if (has_digit) {
    for (auto& counts : shared.counts) {
      const std::uint32_t count = counts[digit];
      counts[digit] = static_cast<std::uint16_t>(own);
      own += count;
    }
  }
  volatile std::uint32_t* const states =
      state.blocks + std::size_t{static_cast<unsigned>(pass)} * gridDim.x * kDigits + digit;
  if (has_digit)
    states[shared.block * kDigits] = (shared.block == 0 ? kSortPrefix : kSortOwn) | own;
  std::uint32_t first = 0;
  cub::BlockScan<std::uint32_t, kSortThreads>(shared.scan).ExclusiveSum(own, first);
  if (!has_digit) return;
  const std::uint32_t before = look_back(states, kDigits, shared.block);
  if (shared.block != 0) states[shared.block * kDigits] = kSortPrefix | (before + own);
  shared.first[digit] = first;
  shared.shift[digit] = state.counts[pass * kDigits + digit] + before - first;
}

template <int kBits, typename Key, typename Count>
__global__ void __launch_bounds__(kSortThreads, resident_blocks(kSortThreads, kBits > 8 ? 3 : 2))
    sort_pass_kernel(SortPass<Key> in, Count count, SortState state) {
  __shared__ SortShared<kBits, Key> shared;
  if (threadIdx.x == 0) shared.block = atomicAdd(state.tickets + in.pass, 1U);
  for (int k = static_cast<int>(threadIdx.x); k < kSortWarps << kBits; k += kSortThreads) {
    shared.counts[k >> kBits][k & ((1 << kBits) - 1)] = 0;
  }
  __syncthreads();
  constexpr int kItems = kSortItems<kBits>;
  const std::uint32_t begin = shared.block * kSortPairs<kBits>;
  const std::uint32_t n = count();
  if (begin >= n) return;
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const std::uint32_t own =
      begin + static_cast<std::uint32_t>(warp) * kWarp * kItems + threadIdx.x % kWarp;
  Key keys[kItems];
  std::uint32_t values[kItems];
  bool valid[kItems];
#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    const std::uint32_t i = own + static_cast<std::uint32_t>(k) * kWarp;
    valid[k] = i < n;
    keys[k] = valid[k] ? in.keys[i] : Key{};
    values[k] = valid[k] && in.values != nullptr ? in.values[i] : i;
  }
  std::uint32_t ranks[kItems];
  rank_keys<kBits>(keys, valid, in.pass, shared.counts[warp], ranks);
  __syncthreads();
  place_digits(shared, state, in.pass);
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    if (!valid[k]) continue;
    const std::uint32_t digit = digit_of<kBits>(keys[k], in.pass);
    const std::uint32_t to = shared.first[digit] + shared.counts[warp][digit] + ranks[k];
    shared.keys[to] = keys[k];
    shared.values[to] = values[k];
  }
  __syncthreads();
  const std::uint32_t size = min(kSortPairs<kBits>, n - begin);
  for (std::uint32_t k = threadIdx.x; k < size; k += kSortThreads) {
    const Key key = shared.keys[k];
    const std::uint32_t to = k + shared.shift[digit_of<kBits>(key, in.pass)];
    if (in.sorted_keys != nullptr) in.sorted_keys[to] = key;
    in.sorted_values[to] = shared.values[k];
  }
}

/// Two buffers for keys and two for values. The first hold the input, and the output after an even
/// number of passes.
template <typename Key>
struct SortBuffers {
  Key* keys[2];
  std::uint32_t* values[2];
  bool numbered;  ///< use 0, 1, ... as input values
};

/// Computes the digit histograms of at most `capacity` keys.
template <int kBits, typename Key, typename Count>
void count_digits(const Key* keys, const Count& count, std::uint32_t capacity, int passes,
                  const SortState& state, cudaStream_t stream) {
  constexpr unsigned kMaxBlocks = 264;
  const unsigned blocks = (capacity + kSortPairs<kBits> - 1) / kSortPairs<kBits>;
  if (blocks == 0) return;
  const auto kernel = count_digits_kernel<kBits, Key, Count>;
  kernel<<<std::min(blocks, kMaxBlocks), kSortThreads, 0, stream>>>(keys, count, passes, state);
}

/// `count`: device callable, the number of pairs; `capacity`: an upper bound. The histograms must
/// be in `state`.
template <int kBits, typename Key, typename Count>
cudaError_t sort_pairs(const SortBuffers<Key>& buffers, const Count& count, std::uint32_t capacity,
                       int passes, const SortState& state, cudaStream_t stream) {
  const unsigned blocks = (capacity + kSortPairs<kBits> - 1) / kSortPairs<kBits>;
  if (blocks == 0) return cudaSuccess;
  const auto sort_pass = sort_pass_kernel<kBits, Key, Count>;
  for (int pass = 0; pass < passes; ++pass) {
    const int from = pass % 2;
    const SortPass<Key> step = {
        .keys = buffers.keys[from],
        .values = pass == 0 && buffers.numbered ? nullptr : buffers.values[from],
        .sorted_keys = pass + 1 < passes ? buffers.keys[1 - from] : nullptr,
        .sorted_values = buffers.values[1 - from],
        .pass = pass};
    sort_pass<<<blocks, kSortThreads, 0, stream>>>(step, count, state);
  }
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
