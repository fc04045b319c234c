// SPDX-License-Identifier: BSD-3-Clause
#include "depth.hpp"

namespace apvi::mapping::cuda {
namespace {

constexpr int kThreads = 32;  // few lines, each on its own: over as many processors as there are
constexpr int kChunk = 16;    // pixels of a line that are read at once
constexpr float kTable = 1024.0f;

/// `count` parallel lines of `length` pixels: pixel i of line j is at i * along + j * across.
struct Lines {
  int count;
  int length;
  int along;
  int across;
};

/// exp(-difference / sigma) between neighbours, in steps as the CPU's table has them.
__device__ float affinity(float a, float b, float sigma) {
  const float difference = roundf(fminf(fabsf(a - b), 1.0f) * kTable) / kTable;
  return expf(-difference / sigma);
}

/// What the next pixel of a line is solved with.
struct Carried {
  float before = 0.0f;  ///< coupling to the previous pixel
  float above = 0.0f;
  float last[kPlanesPerPixel] = {};
};

/// `kChunk` pixels from `first` on: all are read before the first is solved, so that a line waits
/// for memory once a chunk and not at every pixel.
__device__ void eliminate(const Lines& lines, std::int64_t start, std::int64_t plane, int first,
                          float lambda, float sigma, const float* guide, float* upper,
                          float* planes, Carried& carried) {
  float grey[kChunk + 1];
  float value[kPlanesPerPixel][kChunk];
  const auto at = [&](int i) { return start + static_cast<std::int64_t>(i) * lines.along; };
#pragma unroll
  for (int k = 0; k <= kChunk; ++k) grey[k] = guide[at(min(first + k, lines.length - 1))];
#pragma unroll
  for (int k = 0; k < kChunk; ++k) {
    for (int n = 0; n < kPlanesPerPixel; ++n) {
      value[n][k] = planes[n * plane + at(min(first + k, lines.length - 1))];
    }
  }
#pragma unroll
  for (int k = 0; k < kChunk; ++k) {
    const int i = first + k;
    if (i >= lines.length) return;
    const float after =
        i + 1 < lines.length ? lambda * affinity(grey[k], grey[k + 1], sigma) : 0.0f;
    const float inverse = 1.0f / (1.0f + carried.before + after - carried.before * carried.above);
    carried.above = after * inverse;
    upper[at(i)] = carried.above;
    for (int n = 0; n < kPlanesPerPixel; ++n) {
      carried.last[n] = (value[n][k] + carried.before * carried.last[n]) * inverse;
      planes[n * plane + at(i)] = carried.last[n];
    }
    carried.before = after;
  }
}

/// Backwards from `last`, whose successor is solved.
__device__ void substitute(const Lines& lines, std::int64_t start, std::int64_t plane, int last,
                           const float* upper, float* planes, Carried& carried) {
  float factor[kChunk];
  float value[kPlanesPerPixel][kChunk];
  const auto at = [&](int i) { return start + static_cast<std::int64_t>(i) * lines.along; };
#pragma unroll
  for (int k = 0; k < kChunk; ++k) {
    const std::int64_t p = at(max(last - k, 0));
    factor[k] = upper[p];
    for (int n = 0; n < kPlanesPerPixel; ++n) value[n][k] = planes[n * plane + p];
  }
#pragma unroll
  for (int k = 0; k < kChunk; ++k) {
    if (last - k < 0) return;
    for (int n = 0; n < kPlanesPerPixel; ++n) {
      carried.last[n] = value[n][k] + factor[k] * carried.last[n];
      planes[n * plane + at(last - k)] = carried.last[n];
    }
  }
}

/// Thomas' algorithm, one thread a line.
__global__ void solve_kernel(Lines lines, std::int64_t plane, float lambda, float sigma,
                             const float* guide, float* upper, float* planes) {
  const int line = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
  if (line >= lines.count) return;
  const std::int64_t start = static_cast<std::int64_t>(line) * lines.across;
  Carried carried;
  for (int first = 0; first < lines.length; first += kChunk) {
    eliminate(lines, start, plane, first, lambda, sigma, guide, upper, planes, carried);
  }
  for (int last = lines.length - 2; last >= 0; last -= kChunk) {
    substitute(lines, start, plane, last, upper, planes, carried);
  }
}

}  // namespace

cudaError_t launch_smooth_lines(const float* guide, int height, int width, bool rows, float lambda,
                                float sigma, float* upper, float* planes, cudaStream_t stream) {
  if (height * width == 0) return cudaSuccess;
  const Lines lines = rows ? Lines{height, width, 1, width} : Lines{width, height, width, 1};
  solve_kernel<<<static_cast<unsigned>((lines.count + kThreads - 1) / kThreads), kThreads, 0,
                 stream>>>(lines, static_cast<std::int64_t>(height) * width, lambda, sigma, guide,
                           upper, planes);
  return cudaGetLastError();
}

}  // namespace apvi::mapping::cuda
