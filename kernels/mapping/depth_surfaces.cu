// SPDX-License-Identifier: BSD-3-Clause
#include "depth.hpp"

namespace apvi::mapping::cuda {
namespace {

constexpr int kThreads = 128;

__device__ float within(double value, double limit) {
  return static_cast<float>(fmin(fmax(value, -limit), limit));
}

/// One thread a block of the quadtree.
__global__ void surfaces_kernel(const __grid_constant__ SurfacePointers in) {
  const int i = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
  if (i >= in.nodes) return;
  double xx = 1.0, xy = 0.0, yy = 1.0, xw = 0.0, yw = 0.0;
  int alike = 0;
  const int begin = in.offsets[i];
  const int end = in.offsets[i + 1];
  for (int e = begin; e < end; ++e) {
    const int j = in.neighbors[e];
    const double dw = static_cast<double>(in.inverse_depths[j] / in.inverse_depths[i]) - 1.0;
    if (fabs(dw) > in.same) continue;
    ++alike;
    const double dx = in.places[2 * j] - in.places[2 * i];
    const double dy = in.places[2 * j + 1] - in.places[2 * i + 1];
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
    xw += dx * dw;
    yw += dy * dw;
  }
  const double determinant = xx * yy - xy * xy;
  in.slope[2 * i] = within((yy * xw - xy * yw) / determinant, in.steepest);
  in.slope[2 * i + 1] = within((xx * yw - xy * xw) / determinant, in.steepest);
  in.agreement[i] =
      end > begin ? static_cast<float>(alike) / static_cast<float>(end - begin) : 1.0f;
}

}  // namespace

cudaError_t launch_surfaces(const SurfacePointers& in, cudaStream_t stream) {
  if (in.nodes == 0) return cudaSuccess;
  const auto blocks = static_cast<unsigned>((in.nodes + kThreads - 1) / kThreads);
  surfaces_kernel<<<blocks, kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

}  // namespace apvi::mapping::cuda
