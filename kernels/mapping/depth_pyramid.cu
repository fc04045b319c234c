// SPDX-License-Identifier: BSD-3-Clause
#include "depth.hpp"

namespace apvi::mapping::cuda {
namespace {

constexpr int kThreads = 256;

unsigned blocks_for(int pixels) {
  return static_cast<unsigned>((pixels + kThreads - 1) / kThreads);
}

/// One thread a pixel of the half.
__global__ void halve_kernel(const float* pixels, int stride, int height, int width, float* half) {
  const int i = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
  if (i >= height * width) return;
  const int y = i / width;
  const float* const a = pixels + 2 * y * stride + 2 * (i - y * width);
  const float* const b = a + stride;
  half[i] = 0.25f * (a[0] + a[1] + b[0] + b[1]);
}

/// One thread a pixel.
__global__ void pair_kernel(const float* pixels, int height, int width, std::uint32_t* pairs) {
  const int i = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
  if (i >= height * width) return;
  const int below = i + width < height * width ? i + width : i;
  const auto low = static_cast<std::uint32_t>(lroundf(pixels[i]));
  const auto high = static_cast<std::uint32_t>(lroundf(pixels[below]));
  pairs[i] = low | (high << 16u);
}

}  // namespace

cudaError_t launch_halve(const float* pixels, int height, int width, float* half,
                         cudaStream_t stream) {
  const int small = (height / 2) * (width / 2);
  if (small == 0) return cudaSuccess;
  halve_kernel<<<blocks_for(small), kThreads, 0, stream>>>(pixels, width, height / 2, width / 2,
                                                           half);
  return cudaGetLastError();
}

cudaError_t launch_pair(const float* pixels, int height, int width, std::uint32_t* pairs,
                        cudaStream_t stream) {
  if (height * width == 0) return cudaSuccess;
  pair_kernel<<<blocks_for(height * width), kThreads, 0, stream>>>(pixels, height, width, pairs);
  return cudaGetLastError();
}

}  // namespace apvi::mapping::cuda
