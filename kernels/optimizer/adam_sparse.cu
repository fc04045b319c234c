// SPDX-License-Identifier: BSD-3-Clause
// An Adam step over a whole map from the rasterizer's sparse gradient, without materializing the
// dense gradient of every parameter. The idea of stepping directly from the backward pass is that
// of Faster-GS and related fused optimizers.
#include "gaussians/render/sh_math.hpp"
#include "kernels/optimizer/moments.cuh"
#include "kernels/raster/raster.hpp"

namespace apvi::gaussians::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kGaussians = 128;  // per block
constexpr int kKinds = 6;
// Layout of a Gaussian's row in shared memory: mean, log scales, quaternion, opacity logit,
// constant color coefficient, SH basis, color; an odd stride avoids bank conflicts.
constexpr int kBasisAt = 14;
constexpr int kColorAt = kBasisAt + kMaxShRest;
constexpr int kStride = kColorAt + 4;
__constant__ constexpr int kFirst[kKinds] = {0, 3, 6, 10, 11, kBasisAt};

struct Map {
  AdamGroupPointers kind[kKinds];
  std::int64_t count;
};

__device__ void load_row(const SparseGradientPointers& gradient, std::int64_t row, float* to) {
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

/// Derivative with respect to value `k` of a kind, from the Gaussian's row.
__device__ float derivative(const float* row, int kind, int k) {
  if (kind < kKinds - 1) return row[kFirst[kind] + k];
  return row[kBasisAt + k / 3] * row[kColorAt + k % 3];
}

/// Updates the values of one kind for the Gaussians of a block, contiguous in memory.
template <typename Moment>
__device__ void step_kind(const Map& map, int kind, std::int64_t first, int gaussians,
                          const float* rows, const bool* active, const AdamFactors& f) {
  const AdamGroupPointers a = map.kind[kind];
  auto* const firsts = static_cast<Moment*>(a.first);
  auto* const seconds = static_cast<Moment*>(a.second);
  const auto width = static_cast<int>(a.width);
  const int values = gaussians * width;
  for (int at = static_cast<int>(threadIdx.x) * kVector; at < values; at += kThreads * kVector) {
    const int count = min(kVector, values - at);
    const std::int64_t to = first * width + at;
    Vector<float> p = load_vector(a.parameter + to, count);
    Vector<Moment> m = load_vector(firsts + to, count);
    Vector<Moment> v = load_vector(seconds + to, count);
    int i = at / width;
    int k = at % width;
#pragma unroll
    for (int j = 0; j < kVector; ++j) {
      if (j < count && active[i]) {
        const auto place = static_cast<unsigned>(to + j) * kKinds + static_cast<unsigned>(kind);
        step_value(p.x[j], derivative(rows + i * kStride, kind, k), m.x[j], v.x[j], a.rate, f,
                   place);
      }
      if (++k == width) {
        k = 0;
        ++i;
      }
    }
    store_vector(p, a.parameter + to, count);
    store_vector(m, firsts + to, count);
    store_vector(v, seconds + to, count);
  }
}

template <typename Moment>
__global__ void __launch_bounds__(kThreads)
    adam_sparse_kernel(Map map, SparseGradientPointers gradient, AdamFactors f, bool visible_only) {
  __shared__ float rows[kGaussians * kStride];
  __shared__ bool active[kGaussians + 1];
  const std::int64_t first = static_cast<std::int64_t>(blockIdx.x) * kGaussians;
  const int gaussians = static_cast<int>(min(std::int64_t{kGaussians}, map.count - first));
  if (static_cast<int>(threadIdx.x) < gaussians) {
    const std::int32_t row = gradient.row[first + threadIdx.x];
    load_row(gradient, row, rows + threadIdx.x * kStride);
    active[threadIdx.x] = row >= 0 || !visible_only;
  }
  __syncthreads();
  for (int kind = 0; kind < kKinds; ++kind) {
    if (map.kind[kind].width == 0) continue;
    step_kind<Moment>(map, kind, first, gaussians, rows, active, f);
  }
}

}  // namespace

cudaError_t launch_adam_sparse(const AdamGroupPointers* groups, std::int64_t count,
                               const SparseGradientPointers& gradient, const AdamFactors& factors,
                               bool visible_only, cudaStream_t stream) {
  if (count == 0) return cudaSuccess;
  Map map = {};
  map.count = count;
  for (int k = 0; k < kKinds; ++k) map.kind[k] = groups[k];
  const auto blocks = static_cast<unsigned>((count + kGaussians - 1) / kGaussians);
  const auto kernel = groups[0].is_bf16 ? adam_sparse_kernel<Half> : adam_sparse_kernel<float>;
  kernel<<<blocks, kThreads, 0, stream>>>(map, gradient, factors, visible_only);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
