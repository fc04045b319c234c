// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Reductions with a fixed order of summation.
namespace apvi::gaussians::cuda {

inline constexpr unsigned kAllLanes = 0xffffffffU;
inline constexpr int kWarp = 32;

/// Blocks of a multiprocessor, for __launch_bounds__: `wanted`, but no more than its threads allow.
constexpr int resident_blocks(int threads, int wanted) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
  constexpr int kMaxThreads = 1024;  // of compute capability 7.5
#else
  constexpr int kMaxThreads = 1536;
#endif
  return wanted * threads > kMaxThreads ? kMaxThreads / threads : wanted;
}

/// Sum over the lanes of a warp, returned to all lanes.
template <typename T>
__device__ inline T warp_sum(T value) {
  for (int by = kWarp / 2; by > 0; by /= 2) value += __shfl_xor_sync(kAllLanes, value, by);
  return value;
}

/// Maximum over the lanes of a warp, returned to all lanes.
__device__ inline int warp_max(int value) {
#if __CUDA_ARCH__ >= 800
  return __reduce_max_sync(kAllLanes, value);
#else
  for (int by = kWarp / 2; by > 0; by /= 2) {
    value = max(value, __shfl_xor_sync(kAllLanes, value, by));
  }
  return value;
#endif
}

/// Sums of several values over a block; thread k returns sum k. `warps` is shared memory that must
/// not be reused before the next barrier.
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

}  // namespace apvi::gaussians::cuda
