// SPDX-License-Identifier: BSD-3-Clause
#include "kernels/depth/depth.hpp"

namespace apvi::depth::cuda {
namespace {

constexpr int kThreads = 256;
constexpr float kTable = 1024.0f;
constexpr int kTypicalPixelsPerThread = 4;  // for images of up to 1024 px
constexpr int kMaxPixelsPerThread = kMaxLineLength / kThreads;

/// `count` parallel lines of `length` pixels: pixel i of line j is at i * along + j * across.
struct Lines {
  int count;
  int length;
  int along;
  int across;
};

/// exp(-difference / sigma) between neighbors, quantized like the table on the CPU.
__device__ float affinity(float a, float b, float sigma) {
  const float difference = roundf(fminf(fabsf(a - b), 1.0f) * kTable) / kTable;
  return expf(-difference / sigma);
}

/// One equation of a line, u[i] = before u[i - stride] + after u[i + stride] + value.
struct Equation {
  float before;
  float after;
  float value[kPlanesPerPixel];
};
static_assert(kPlanesPerPixel == 2 && sizeof(Equation) == sizeof(float4));

__device__ Equation equation_of(const Lines& lines, std::int64_t start, std::int64_t plane, int i,
                                float lambda, float sigma, const float* guide,
                                const float* planes) {
  const std::int64_t at = start + static_cast<std::int64_t>(i) * lines.along;
  const float gray = guide[at];
  const float before = i > 0 ? lambda * affinity(guide[at - lines.along], gray, sigma) : 0.0f;
  const float after =
      i + 1 < lines.length ? lambda * affinity(gray, guide[at + lines.along], sigma) : 0.0f;
  const float inverse = 1.0f / (1.0f + before + after);
  return {before * inverse, after * inverse, {planes[at] * inverse, planes[plane + at] * inverse}};
}

/// Eliminates the neighbors from `own`, which then couples pixels at twice the distance.
__device__ Equation eliminate(const Equation& own, const Equation& before, const Equation& after) {
  const float inverse = 1.0f / (1.0f - own.before * before.after - own.after * after.before);
  Equation out = {own.before * before.before * inverse, own.after * after.after * inverse, {}};
#pragma unroll
  for (int n = 0; n < kPlanesPerPixel; ++n) {
    out.value[n] =
        (own.value[n] + own.before * before.value[n] + own.after * after.value[n]) * inverse;
  }
  return out;
}

/// Parallel cyclic reduction (Hockney and Jesshope, "Parallel computers", 1981), one thread block
/// per line, `K` pixels per thread. The Thomas algorithm of the CPU is sequential along a line.
template <int K>
__global__ void solve_kernel(Lines lines, std::int64_t plane, float lambda, float sigma,
                             const float* guide, float* planes) {
  extern __shared__ float4 shared[];
  auto* const line = reinterpret_cast<Equation*>(shared);
  const std::int64_t start = static_cast<std::int64_t>(blockIdx.x) * lines.across;
  const int first = static_cast<int>(threadIdx.x);
  Equation own[K];
#pragma unroll
  for (int k = 0; k < K; ++k) {
    const int i = first + k * kThreads;
    if (i >= lines.length) break;
    own[k] = equation_of(lines, start, plane, i, lambda, sigma, guide, planes);
    line[i] = own[k];
  }
  constexpr Equation kNone = {};
  for (int stride = 1; stride < lines.length; stride *= 2) {
    __syncthreads();
#pragma unroll
    for (int k = 0; k < K; ++k) {
      const int i = first + k * kThreads;
      if (i >= lines.length) break;
      own[k] = eliminate(own[k], i >= stride ? line[i - stride] : kNone,
                         i + stride < lines.length ? line[i + stride] : kNone);
    }
    __syncthreads();
#pragma unroll
    for (int k = 0; k < K; ++k) {
      const int i = first + k * kThreads;
      if (i < lines.length) line[i] = own[k];
    }
  }
#pragma unroll
  for (int k = 0; k < K; ++k) {
    const int i = first + k * kThreads;
    if (i >= lines.length) break;
    const std::int64_t at = start + static_cast<std::int64_t>(i) * lines.along;
    for (int n = 0; n < kPlanesPerPixel; ++n) planes[n * plane + at] = own[k].value[n];
  }
}

template <int K>
cudaError_t solve(const Lines& lines, std::int64_t plane, float lambda, float sigma,
                  const float* guide, float* planes, cudaStream_t stream) {
  const std::size_t bytes = static_cast<std::size_t>(lines.length) * sizeof(Equation);
  const cudaError_t error = cudaFuncSetAttribute(
      solve_kernel<K>, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(bytes));
  if (error != cudaSuccess) return error;
  solve_kernel<K><<<static_cast<unsigned>(lines.count), kThreads, bytes, stream>>>(
      lines, plane, lambda, sigma, guide, planes);
  return cudaGetLastError();
}

}  // namespace

cudaError_t launch_smooth_lines(const float* guide, int height, int width, bool rows, float lambda,
                                float sigma, float* planes, cudaStream_t stream) {
  if (height * width == 0) return cudaSuccess;
  const Lines lines = rows ? Lines{height, width, 1, width} : Lines{width, height, width, 1};
  const std::int64_t plane = static_cast<std::int64_t>(height) * width;
  if (lines.length > kMaxLineLength) return cudaErrorInvalidValue;
  const auto solved = lines.length <= kTypicalPixelsPerThread * kThreads
                          ? solve<kTypicalPixelsPerThread>
                          : solve<kMaxPixelsPerThread>;
  return solved(lines, plane, lambda, sigma, guide, planes, stream);
}

}  // namespace apvi::depth::cuda
