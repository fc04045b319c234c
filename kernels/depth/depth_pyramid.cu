// SPDX-License-Identifier: BSD-3-Clause
#include "kernels/depth/depth.hpp"

namespace apvi::depth::cuda {
namespace {

constexpr int kThreads = 256;

__device__ float mean_of_four(const ReductionJob& job, int x, int y) {
  const float* const a = job.from + 2 * y * job.from_width + 2 * x;
  const float* const b = a + job.from_width;
  return 0.25f * (a[0] + a[1] + b[0] + b[1]);
}

/// One thread per pixel, one row of thread blocks per image.
__global__ void reduce_kernel(const __grid_constant__ ReductionJobs in) {
  const ReductionJob& job = in.jobs[blockIdx.y];
  const int i = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
  if (i >= job.height * job.width) return;
  const int y = i / job.width;
  const int x = i - y * job.width;
  const int below = min(y + 1, job.height - 1);
  const auto pixel = [&](int row) {
    return in.halve ? mean_of_four(job, x, row) : in.unit * job.from[row * job.width + x];
  };
  const float value = pixel(y);
  job.to[i] = value;
  job.pairs[i] = static_cast<std::uint32_t>(lroundf(value)) |
                 static_cast<std::uint32_t>(lroundf(pixel(below))) << 16u;
}

}  // namespace

cudaError_t launch_reduction(const ReductionJobs& in, cudaStream_t stream) {
  int max_pixels = 0;
  for (int i = 0; i < in.count; ++i) {
    const int pixels = in.jobs[i].width * in.jobs[i].height;
    max_pixels = pixels > max_pixels ? pixels : max_pixels;
  }
  if (max_pixels == 0) return cudaSuccess;
  const dim3 blocks(static_cast<unsigned>((max_pixels + kThreads - 1) / kThreads),
                    static_cast<unsigned>(in.count));
  reduce_kernel<<<blocks, kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

}  // namespace apvi::depth::cuda
