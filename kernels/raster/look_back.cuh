// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "kernels/raster/gaussian_loading.cuh"

/// Single-pass prefix sum over blocks: a block obtains its offset from the blocks before it while
/// they run (Merrill and Garland, "Single-pass parallel prefix scan with decoupled look-back",
/// 2016).
namespace apvi::gaussians::cuda {

using Packed = unsigned long long;

// A count of splats and a count of slots in one word, with the status in the upper bits.
inline constexpr int kSlotBits = 34;
inline constexpr Packed kValue = (Packed{1} << 62) - 1;
inline constexpr Packed kOwn = Packed{1} << 62;     // the count of the block alone
inline constexpr Packed kPrefix = Packed{1} << 63;  // the inclusive prefix

__device__ inline Packed pack(std::uint32_t splats, std::uint32_t slots) {
  return static_cast<Packed>(splats) << kSlotBits | slots;
}
__device__ inline std::uint32_t splats_in(Packed p) {
  return static_cast<std::uint32_t>((p & kValue) >> kSlotBits);
}
__device__ inline std::uint32_t slots_in(Packed p) {
  return static_cast<std::uint32_t>(p & ((Packed{1} << kSlotBits) - 1));
}

/// Counts of all blocks before `block`, computed by the first warp, which also publishes the
/// block's own count.
__device__ inline Packed count_before(volatile Packed* states, unsigned block, Packed own) {
  const int lane = static_cast<int>(threadIdx.x);
  if (lane == 0) states[block] = (block == 0 ? kPrefix : kOwn) | own;
  Packed before = 0;
  for (int at = static_cast<int>(block) - 1 - lane; block != 0; at -= kWarp) {
    Packed state = kPrefix;
    do {
      if (at >= 0) state = states[at];
    } while (__any_sync(kAllLanes, (state & (kOwn | kPrefix)) == 0));
    const unsigned known = __ballot_sync(kAllLanes, (state & kPrefix) != 0);
    const int last = known != 0 ? __ffs(static_cast<int>(known)) - 1 : kWarp - 1;
    before += warp_sum(lane <= last ? state & kValue : Packed{0});
    if (known != 0) break;
  }
  if (lane == 0 && block != 0) states[block] = kPrefix | (before + own);
  return before;
}

/// Index of a block in the order of execution start, required for forward progress of waiting
/// blocks. The state after the last block is the counter.
__device__ inline unsigned take_ticket(Packed* states, unsigned blocks, unsigned& shared) {
  if (threadIdx.x == 0) shared = static_cast<unsigned>(atomicAdd(states + blocks, Packed{1}));
  __syncthreads();
  return shared;
}

}  // namespace apvi::gaussians::cuda
