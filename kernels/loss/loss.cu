// SPDX-License-Identifier: BSD-3-Clause
// L1 and SSIM of an image in one pass over tiles in shared memory, and the derivative in another. A
// row of pixels is treated as 3 W interleaved values; neighbors of the same color are three apart.
#include "kernels/loss/loss.hpp"

#include "gaussians/metrics/ssim_math.hpp"
#include "kernels/common/warp.cuh"

namespace apvi::gaussians::cuda {
namespace {

constexpr int kTilePixelsX = 16;
constexpr int kTileY = 16;
constexpr int kTileX = 3 * kTilePixelsX;  // values
constexpr int kRadius = 5;
constexpr int kHaloX = 3 * kRadius;
constexpr int kLoadX = kTileX + 2 * kHaloX;
constexpr int kLoadY = kTileY + 2 * kRadius;
constexpr int kThreads = 256;
constexpr int kSums = 3;  // L1, SSIM, number of valid values

constexpr float weight_of(int tap) {
  return static_cast<float>(kSsimWeights[tap]);
}
__constant__ constexpr float kTaps[kRadius + 1] = {weight_of(0), weight_of(1), weight_of(2),
                                                   weight_of(3), weight_of(4), weight_of(5)};

struct Tile {
  int x0, y0;  ///< first value of the tile, in values and rows
};
__device__ Tile own_tile(const LossImages& in) {
  const int across = (in.width + kTilePixelsX - 1) / kTilePixelsX;
  const int block = static_cast<int>(blockIdx.x);
  return {block % across * kTileX, block / across * kTileY};
}

/// Sum and difference of image and target at a value, masked.
struct Pair {
  float s, d, weight;
};
__device__ Pair pair_at(const LossImages& in, int x, int y) {
  if (x < 0 || y < 0 || x >= 3 * in.width || y >= in.height) return {0.0f, 0.0f, 0.0f};
  const std::int64_t at = static_cast<std::int64_t>(y) * 3 * in.width + x;
  const float weight =
      in.valid == nullptr ? 1.0f : in.valid[static_cast<std::int64_t>(y) * in.width + x / 3];
  const float d = weight * (in.image[at] - in.target[at]);
  return {2.0f * in.target[at] + d, d, weight};
}

__device__ float blur_along(const float* row) {
  float sum = kTaps[0] * row[0];
#pragma unroll
  for (int t = 1; t <= kRadius; ++t) sum = fmaf(kTaps[t], row[-3 * t] + row[3 * t], sum);
  return sum;
}

__device__ float blur_across(const float* column) {
  float sum = kTaps[0] * column[0];
#pragma unroll
  for (int t = 1; t <= kRadius; ++t) {
    sum = fmaf(kTaps[t], column[-t * kTileX] + column[t * kTileX], sum);
  }
  return sum;
}

__global__ void __launch_bounds__(kThreads)
    compare_kernel(LossImages in, float* maps, float* partials) {
  __shared__ float s[kLoadY][kLoadX];
  __shared__ float d[kLoadY][kLoadX];
  __shared__ float blurred[4][kLoadY][kTileX];
  __shared__ float warps[kThreads / kWarp][kSums];
  const Tile tile = own_tile(in);
  const auto thread = static_cast<int>(threadIdx.x);
  for (int k = thread; k < kLoadX * kLoadY; k += kThreads) {
    const int x = k % kLoadX;
    const int y = k / kLoadX;
    const Pair pair = pair_at(in, tile.x0 + x - kHaloX, tile.y0 + y - kRadius);
    s[y][x] = pair.s;
    d[y][x] = pair.d;
  }
  __syncthreads();
  for (int k = thread; k < kTileX * kLoadY; k += kThreads) {
    const int x = k % kTileX;
    const int y = k / kTileX;
    const float* const srow = &s[y][x + kHaloX];
    const float* const drow = &d[y][x + kHaloX];
    float ss = kTaps[0] * srow[0] * srow[0];
    float dd = kTaps[0] * drow[0] * drow[0];
#pragma unroll
    for (int t = 1; t <= kRadius; ++t) {
      ss = fmaf(kTaps[t], srow[-3 * t] * srow[-3 * t] + srow[3 * t] * srow[3 * t], ss);
      dd = fmaf(kTaps[t], drow[-3 * t] * drow[-3 * t] + drow[3 * t] * drow[3 * t], dd);
    }
    blurred[0][y][x] = blur_along(srow);
    blurred[1][y][x] = blur_along(drow);
    blurred[2][y][x] = ss;
    blurred[3][y][x] = dd;
  }
  __syncthreads();
  float sums[kSums] = {};
  const std::int64_t values = static_cast<std::int64_t>(in.height) * in.width * 3;
  for (int k = thread; k < kTileX * kTileY; k += kThreads) {
    const int x = k % kTileX;
    const int y = k / kTileX;
    if (tile.x0 + x >= 3 * in.width || tile.y0 + y >= in.height) continue;
    float mean[4];
    for (int m = 0; m < 4; ++m) mean[m] = blur_across(&blurred[m][y + kRadius][x]);
    const Ssim<float> ssim(mean[0], mean[1], mean[2], mean[3]);
    const float weight = pair_at(in, tile.x0 + x, tile.y0 + y).weight;
    sums[0] += fabsf(d[y + kRadius][x + kHaloX]);
    sums[1] += weight * ssim.value;
    sums[2] += weight;
    if (maps == nullptr) continue;
    const std::int64_t at = static_cast<std::int64_t>(tile.y0 + y) * 3 * in.width + tile.x0 + x;
    maps[at] = weight * ssim.d_mean;
    maps[values + at] = weight * ssim.d_ss;
    maps[2 * values + at] = weight * ssim.d_dd;
  }
  const float sum = block_sums<kThreads>(sums, warps);
  if (thread < kSums) partials[blockIdx.x * kSums + thread] = sum;
}

__global__ void add_up_kernel(const float* partials, int blocks, float ssim_weight, float* loss,
                              float* inv_count) {
  __shared__ double parts[kSums][kThreads];
  double sums[kSums] = {};
  for (int b = static_cast<int>(threadIdx.x); b < blocks; b += kThreads) {
    for (int k = 0; k < kSums; ++k) sums[k] += static_cast<double>(partials[b * kSums + k]);
  }
  for (int k = 0; k < kSums; ++k) parts[k][threadIdx.x] = sums[k];
  for (int offset = kThreads / 2; offset > 0; offset /= 2) {
    __syncthreads();
    if (static_cast<int>(threadIdx.x) >= offset) continue;
    for (int k = 0; k < kSums; ++k) parts[k][threadIdx.x] += parts[k][threadIdx.x + offset];
  }
  if (threadIdx.x != 0) return;
  const double inverse = parts[2][0] > 0.0 ? 1.0 / parts[2][0] : 0.0;
  const auto w = static_cast<double>(ssim_weight);
  const double total = (1.0 - w) * parts[0][0] * inverse + w * (1.0 - parts[1][0] * inverse);
  *loss = inverse > 0.0 ? static_cast<float>(total) : 0.0f;
  *inv_count = static_cast<float>(inverse);
}

__global__ void __launch_bounds__(kThreads)
    differentiate_kernel(LossImages in, const float* maps, const float* inv_count,
                         const float* grad_loss, float* gradient) {
  __shared__ float loaded[kLossMaps][kLoadY][kLoadX];
  __shared__ float blurred[kLossMaps][kLoadY][kTileX];
  const Tile tile = own_tile(in);
  const auto thread = static_cast<int>(threadIdx.x);
  const int length = 3 * in.width;
  const std::int64_t values = static_cast<std::int64_t>(in.height) * length;
  for (int k = thread; k < kLoadX * kLoadY; k += kThreads) {
    const int x = tile.x0 + k % kLoadX - kHaloX;
    const int y = tile.y0 + k / kLoadX - kRadius;
    const bool inside = x >= 0 && y >= 0 && x < length && y < in.height;
    for (int m = 0; m < kLossMaps; ++m) {
      loaded[m][k / kLoadX][k % kLoadX] =
          inside ? maps[m * values + static_cast<std::int64_t>(y) * length + x] : 0.0f;
    }
  }
  __syncthreads();
  for (int k = thread; k < kTileX * kLoadY; k += kThreads) {
    const int x = k % kTileX;
    const int y = k / kTileX;
    for (int m = 0; m < kLossMaps; ++m) blurred[m][y][x] = blur_along(&loaded[m][y][x + kHaloX]);
  }
  __syncthreads();
  const float l1 = (1.0f - in.ssim_weight) * *inv_count * *grad_loss;
  const float d_ssim = -in.ssim_weight * *inv_count * *grad_loss;
  for (int k = thread; k < kTileX * kTileY; k += kThreads) {
    const int x = k % kTileX;
    const int y = k / kTileX;
    if (tile.x0 + x >= length || tile.y0 + y >= in.height) continue;
    float grad[kLossMaps];
    for (int m = 0; m < kLossMaps; ++m) grad[m] = blur_across(&blurred[m][y + kRadius][x]);
    const Pair pair = pair_at(in, tile.x0 + x, tile.y0 + y);
    const float sign = pair.d > 0.0f ? l1 : (pair.d < 0.0f ? -l1 : 0.0f);
    gradient[static_cast<std::int64_t>(tile.y0 + y) * length + tile.x0 + x] =
        sign + d_ssim * pair.weight * (grad[0] + 2.0f * (pair.s * grad[1] + pair.d * grad[2]));
  }
}

}  // namespace

std::int64_t loss_blocks(int width, int height) {
  return static_cast<std::int64_t>((width + kTilePixelsX - 1) / kTilePixelsX) *
         ((height + kTileY - 1) / kTileY);
}

cudaError_t launch_loss_forward(const LossImages& in, float* maps, float* partials, float* loss,
                                float* inv_count, cudaStream_t stream) {
  const auto blocks = static_cast<unsigned>(loss_blocks(in.width, in.height));
  compare_kernel<<<blocks, kThreads, 0, stream>>>(in, maps, partials);
  add_up_kernel<<<1, kThreads, 0, stream>>>(partials, static_cast<int>(blocks), in.ssim_weight,
                                            loss, inv_count);
  return cudaGetLastError();
}

cudaError_t launch_loss_backward(const LossImages& in, const float* maps, const float* inv_count,
                                 const float* grad_loss, float* gradient, cudaStream_t stream) {
  const auto blocks = static_cast<unsigned>(loss_blocks(in.width, in.height));
  differentiate_kernel<<<blocks, kThreads, 0, stream>>>(in, maps, inv_count, grad_loss, gradient);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
