// SPDX-License-Identifier: BSD-3-Clause
// A step of Adam over a whole map that takes the derivatives as the rasterizer has them: nobody
// writes and reads them for every parameter of every Gaussian. The idea of stepping from what the
// backward pass holds is that of Faster-GS and of the fused optimisers beside it.
#include "adam.hpp"
#include "apvi/splat/sh_math.hpp"
#include "raster.hpp"

namespace apvi::splat::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kGaussians = 128;  // of a block
constexpr int kVector = 4;
constexpr int kKinds = 6;
// What a Gaussian's row becomes in shared memory: mean, log scales, quaternion, logit of opacity,
// constant colour coefficient, basis, colour; an odd number, so that rows begin in all banks.
constexpr int kBasisAt = 14;
constexpr int kColorAt = kBasisAt + kMaxShRest;
constexpr int kStride = kColorAt + 4;
__constant__ constexpr int kFirst[kKinds] = {0, 3, 6, 10, 11, kBasisAt};

struct Map {
  AdamGroupPointers kind[kKinds];
  std::int64_t count;
};

__device__ void load_row(const GradientRows& gradient, std::int64_t row, float* to) {
  for (int k = 0; k < kStride; ++k) to[k] = 0.0f;
  if (row < 0) return;
  const float* const from = gradient.rows + row * kRowFloats;
  for (int k = 0; k < 11; ++k) to[k] = from[k];
  for (int c = 0; c < 3; ++c) {
    to[11 + c] = from[11 + c] * static_cast<float>(kSh0);
    to[kColorAt + c] = from[11 + c];
  }
  sh_basis(gradient.sh_degree, from[14], from[15], from[16], to + kBasisAt);
}

/// The derivative by value `k` of a kind, from the Gaussian's row.
__device__ float derivative(const float* row, int kind, int k) {
  if (kind < kKinds - 1) return row[kFirst[kind] + k];
  return row[kBasisAt + k / 3] * row[kColorAt + k % 3];
}

struct Four {
  float x[kVector];
};
__device__ Four load_four(const float* from, int count) {
  Four out;
  if (count == kVector) {
    const float4 v = *reinterpret_cast<const float4*>(from);
    return {{v.x, v.y, v.z, v.w}};
  }
  for (int k = 0; k < kVector; ++k) out.x[k] = k < count ? from[k] : 0.0f;
  return out;
}
__device__ void store_four(const Four& v, float* to, int count) {
  if (count == kVector) {
    *reinterpret_cast<float4*>(to) = make_float4(v.x[0], v.x[1], v.x[2], v.x[3]);
    return;
  }
  for (int k = 0; k < count; ++k) to[k] = v.x[k];
}

/// The values of one kind of a block's Gaussians, which lie in a row.
__device__ void step_kind(const Map& map, int kind, std::int64_t first, int gaussians,
                          const float* rows, const bool* moves, const AdamFactors& f) {
  const AdamGroupPointers a = map.kind[kind];
  const auto width = static_cast<int>(a.width);
  const int values = gaussians * width;
  for (int at = static_cast<int>(threadIdx.x) * kVector; at < values; at += kThreads * kVector) {
    const int count = min(kVector, values - at);
    const std::int64_t to = first * width + at;
    Four p = load_four(a.parameter + to, count);
    Four m = load_four(a.first + to, count);
    Four v = load_four(a.second + to, count);
    int i = at / width;
    int k = at % width;
#pragma unroll
    for (int j = 0; j < kVector; ++j) {
      if (j < count && moves[i]) {
        const float g = derivative(rows + i * kStride, kind, k);
        m.x[j] = f.keep_first * m.x[j] + (1.0f - f.keep_first) * g;
        v.x[j] = f.keep_second * v.x[j] + (1.0f - f.keep_second) * g * g;
        p.x[j] -= a.rate * m.x[j] / (sqrtf(v.x[j]) * f.root_scale + f.epsilon);
      }
      if (++k == width) {
        k = 0;
        ++i;
      }
    }
    store_four(p, a.parameter + to, count);
    store_four(m, a.first + to, count);
    store_four(v, a.second + to, count);
  }
}

__global__ void __launch_bounds__(kThreads)
    adam_rows_kernel(Map map, GradientRows gradient, AdamFactors f, bool visible_only) {
  __shared__ float rows[kGaussians * kStride];
  __shared__ bool moves[kGaussians + 1];
  const std::int64_t first = static_cast<std::int64_t>(blockIdx.x) * kGaussians;
  const int gaussians = static_cast<int>(min(std::int64_t{kGaussians}, map.count - first));
  if (static_cast<int>(threadIdx.x) < gaussians) {
    const std::int32_t row = gradient.row[first + threadIdx.x];
    load_row(gradient, row, rows + threadIdx.x * kStride);
    moves[threadIdx.x] = row >= 0 || !visible_only;
  }
  __syncthreads();
  for (int kind = 0; kind < kKinds; ++kind) {
    if (map.kind[kind].width > 0) step_kind(map, kind, first, gaussians, rows, moves, f);
  }
}

}  // namespace

cudaError_t launch_adam_rows(const AdamGroupPointers* groups, std::int64_t count,
                             const GradientRows& gradient, const AdamFactors& factors,
                             bool visible_only, cudaStream_t stream) {
  if (count == 0) return cudaSuccess;
  Map map = {};
  map.count = count;
  for (int k = 0; k < kKinds; ++k) map.kind[k] = groups[k];
  const auto blocks = static_cast<unsigned>((count + kGaussians - 1) / kGaussians);
  adam_rows_kernel<<<blocks, kThreads, 0, stream>>>(map, gradient, factors, visible_only);
  return cudaGetLastError();
}

}  // namespace apvi::splat::cuda
