// SPDX-License-Identifier: BSD-3-Clause
// Min-sum belief propagation: one warp per node, `K` adjacent labels per lane.
#include <cfloat>

#include "kernels/depth/depth.hpp"

namespace apvi::depth::cuda {
namespace {

constexpr int kThreads = 128;
constexpr int kLanes = 32;
constexpr unsigned kAll = 0xFFFFFFFFu;

/// A lane's part of a row of labels; padding is FLT_MAX.
template <int K>
struct Row {
  float v[K];
};

template <int K>
__device__ Row<K> load(const float* row, int labels, int first) {
  Row<K> out;
  if constexpr (K % 4 == 0) {
    if (labels == K * kLanes) {
#pragma unroll
      for (int k = 0; k < K; k += 4) {
        const float4 four = *reinterpret_cast<const float4*>(row + first + k);
        out.v[k] = four.x;
        out.v[k + 1] = four.y;
        out.v[k + 2] = four.z;
        out.v[k + 3] = four.w;
      }
      return out;
    }
  }
#pragma unroll
  for (int k = 0; k < K; ++k) out.v[k] = first + k < labels ? row[first + k] : FLT_MAX;
  return out;
}

template <int K>
__device__ void store(const Row<K>& in, float* row, int labels, int first) {
  if constexpr (K % 4 == 0) {
    if (labels == K * kLanes) {
#pragma unroll
      for (int k = 0; k < K; k += 4) {
        *reinterpret_cast<float4*>(row + first + k) = {in.v[k], in.v[k + 1], in.v[k + 2],
                                                       in.v[k + 3]};
      }
      return;
    }
  }
#pragma unroll
  for (int k = 0; k < K; ++k) {
    if (first + k < labels) row[first + k] = in.v[k];
  }
}

/// Truncated linear min-convolution, normalized to a minimum of zero. The value at the end of a
/// lane's labels propagates to the following lanes, K steps more expensive with each.
template <int K>
__device__ void truncated_linear(Row<K>& h, int lane, float step, float limit) {
  float min_value = h.v[0];
#pragma unroll
  for (int k = 1; k < K; ++k) min_value = fminf(min_value, h.v[k]);
  for (int d = kLanes / 2; d > 0; d /= 2)
    min_value = fminf(min_value, __shfl_xor_sync(kAll, min_value, d));
#pragma unroll
  for (int k = 0; k < K; ++k) h.v[k] = fminf(h.v[k] - min_value, limit);
#pragma unroll
  for (int k = 1; k < K; ++k) h.v[k] = fminf(h.v[k], h.v[k - 1] + step);
  float up = h.v[K - 1];
  for (int d = 1; d < kLanes; d *= 2) {
    const float other = __shfl_up_sync(kAll, up, d) + static_cast<float>(d * K) * step;
    if (lane >= d) up = fminf(up, other);
  }
  const float from_below = __shfl_up_sync(kAll, up, 1);
#pragma unroll
  for (int k = 0; k < K; ++k) {
    if (lane > 0) h.v[k] = fminf(h.v[k], from_below + static_cast<float>(k + 1) * step);
  }
#pragma unroll
  for (int k = K - 1; k-- > 0;) h.v[k] = fminf(h.v[k], h.v[k + 1] + step);
  float down = h.v[0];
  for (int d = 1; d < kLanes; d *= 2) {
    const float other = __shfl_down_sync(kAll, down, d) + static_cast<float>(d * K) * step;
    if (lane + d < kLanes) down = fminf(down, other);
  }
  const float from_above = __shfl_down_sync(kAll, down, 1);
#pragma unroll
  for (int k = 0; k < K; ++k) {
    if (lane + 1 < kLanes) h.v[k] = fminf(h.v[k], from_above + static_cast<float>(K - k) * step);
  }
}

template <int K>
__device__ void add(Row<K>& sum, const Row<K>& more, float factor) {
#pragma unroll
  for (int k = 0; k < K; ++k) sum.v[k] += factor * more.v[k];
}

__device__ int node_of_warp() {
  return static_cast<int>(blockIdx.x * kThreads + threadIdx.x) / kLanes;
}

/// Outgoing messages of each node; each excludes the recipient's own message.
template <int K>
__global__ void messages_kernel(GraphPointers g, const float* messages, float* next) {
  const int node = node_of_warp();
  if (node >= g.nodes) return;
  const int lane = static_cast<int>(threadIdx.x) % kLanes;
  const int first = lane * K;
  const auto row = [&g](std::int64_t i) { return i * g.labels; };
  Row<K> sum = load<K>(g.cost + row(node), g.labels, first);
  const int begin = g.offsets[node];
  const int end = g.offsets[node + 1];
  for (int e = begin; e < end; ++e) {
    add<K>(sum, load<K>(messages + row(e), g.labels, first), 1.0f);
  }
  for (int e = begin; e < end; ++e) {
    const Row<K> in = load<K>(messages + row(e), g.labels, first);
    Row<K> out;
#pragma unroll
    for (int k = 0; k < K; ++k) out.v[k] = first + k < g.labels ? sum.v[k] - in.v[k] : FLT_MAX;
    truncated_linear<K>(out, lane, g.weights[e] * g.step, g.weights[e] * g.limit);
    store<K>(out, next + row(g.reverse[e]), g.labels, first);
  }
}

template <int K>
__global__ void beliefs_kernel(GraphPointers g, const float* a, const float* b, float* belief) {
  const int node = node_of_warp();
  if (node >= g.nodes) return;
  const int first = static_cast<int>(threadIdx.x) % kLanes * K;
  const auto row = [&g](std::int64_t i) { return i * g.labels; };
  Row<K> sum = load<K>(g.cost + row(node), g.labels, first);
  for (int e = g.offsets[node]; e < g.offsets[node + 1]; ++e) {
    Row<K> mean = load<K>(a + row(e), g.labels, first);
    add<K>(mean, load<K>(b + row(e), g.labels, first), 1.0f);
    add<K>(sum, mean, 0.5f);
  }
  store<K>(sum, belief + row(node), g.labels, first);
}

template <int K>
cudaError_t start(const GraphPointers& in, const float* a, const float* b, float* out,
                  cudaStream_t stream) {
  constexpr int kNodes = kThreads / kLanes;
  const auto blocks = static_cast<unsigned>((in.nodes + kNodes - 1) / kNodes);
  if (b == nullptr) {
    messages_kernel<K><<<blocks, kThreads, 0, stream>>>(in, a, out);
  } else {
    beliefs_kernel<K><<<blocks, kThreads, 0, stream>>>(in, a, b, out);
  }
  return cudaGetLastError();
}

/// Computes messages if `b` is null, otherwise beliefs.
cudaError_t launch(const GraphPointers& in, const float* a, const float* b, float* out,
                   cudaStream_t stream) {
  if (in.nodes == 0 || in.labels == 0) return cudaSuccess;
  if (in.labels <= 1 * kLanes) return start<1>(in, a, b, out, stream);
  if (in.labels <= 2 * kLanes) return start<2>(in, a, b, out, stream);
  if (in.labels <= 4 * kLanes) return start<4>(in, a, b, out, stream);
  if (in.labels <= 8 * kLanes) return start<8>(in, a, b, out, stream);
  if (in.labels <= kMaxLabels) return start<kMaxLabels / kLanes>(in, a, b, out, stream);
  return cudaErrorInvalidValue;
}

}  // namespace

cudaError_t launch_messages(const GraphPointers& in, const float* messages, float* next,
                            cudaStream_t stream) {
  return launch(in, messages, nullptr, next, stream);
}

cudaError_t launch_beliefs(const GraphPointers& in, const float* a, const float* b, float* belief,
                           cudaStream_t stream) {
  return launch(in, a, b, belief, stream);
}

}  // namespace apvi::depth::cuda
