// SPDX-License-Identifier: BSD-3-Clause
#include "depth/plane_fit.hpp"
#include "kernels/depth/depth.hpp"

namespace apvi::depth::cuda {
namespace {

constexpr int kThreads = 128;

/// One thread per block of the quadtree.
__global__ void plane_fit_kernel(const __grid_constant__ PlaneFitPointers in) {
  const int i = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
  if (i >= in.nodes) return;
  PlaneFit surface;
  const int begin = in.offsets[i];
  const int end = in.offsets[i + 1];
  for (int e = begin; e < end; ++e) {
    const int j = in.neighbors[e];
    const double dw = static_cast<double>(in.inverse_depths[j] / in.inverse_depths[i]) - 1.0;
    if (fabs(dw) > in.max_relative_difference) continue;
    surface.add(in.places[2 * j] - in.places[2 * i], in.places[2 * j + 1] - in.places[2 * i + 1],
                dw);
  }
  in.slope[2 * i] = surface.slope_x(in.max_slope);
  in.slope[2 * i + 1] = surface.slope_y(in.max_slope);
  in.agreement[i] = surface.agreement(end - begin);
}

}  // namespace

cudaError_t launch_plane_fit(const PlaneFitPointers& in, cudaStream_t stream) {
  if (in.nodes == 0) return cudaSuccess;
  const auto blocks = static_cast<unsigned>((in.nodes + kThreads - 1) / kThreads);
  plane_fit_kernel<<<blocks, kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

}  // namespace apvi::depth::cuda
