// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Sums whose order does not change.
namespace apvi::splat::cuda {

inline constexpr unsigned kAllLanes = 0xffffffffU;
inline constexpr int kWarp = 32;

/// The sum of a value over the lanes; all lanes have it.
template <typename T>
__device__ inline T warp_sum(T value) {
  for (int by = kWarp / 2; by > 0; by /= 2) value += __shfl_xor_sync(kAllLanes, value, by);
  return value;
}

/// The sums of some values over a block; result k is thread k's. `warps` is shared memory, which
/// nobody else uses before the next barrier.
template <int kThreads, int kValues>
__device__ inline float block_sums(const float (&values)[kValues],
                                   float (&warps)[kThreads / kWarp][kValues]) {
  for (int k = 0; k < kValues; ++k) {
    const float sum = warp_sum(values[k]);
    if (threadIdx.x % kWarp == 0) warps[threadIdx.x / kWarp][k] = sum;
  }
  __syncthreads();
  float sum = 0.0f;
  if (threadIdx.x < kValues) {
    for (const auto& warp : warps) sum += warp[threadIdx.x];
  }
  return sum;
}

}  // namespace apvi::splat::cuda
