// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_pipeline_primitives.h>

#include "apvi/splat/sh_math.hpp"
#include "raster.hpp"
#include "warp.cuh"

/// What the projection and its derivative both do with the parameters of a Gaussian.
namespace apvi::splat::cuda {

/// Floats of a row of coefficients in shared memory; odd, so that threads that read their own rows
/// do not meet in a bank.
inline constexpr int kShStride = 3 * kMaxShRest;

/// Everything about a Gaussian that both passes need.
struct Shape {
  float mean[3];
  Projection<float> f;
  float opacity;  ///< as the parameter says
  float fade;     ///< what the anti-aliasing leaves of it
};

__device__ inline void load3(const float* from, std::int64_t i, float* to) {
  for (int k = 0; k < 3; ++k) to[k] = from[3 * i + k];
}

__device__ inline Shape load_shape(const GaussianPointers& g, const Frame& frame, std::int64_t i) {
  Shape out;
  float deviations[3];
  load3(g.means, i, out.mean);
  load3(g.log_scales, i, deviations);
  const float4 q = reinterpret_cast<const float4*>(g.quaternions)[i];
  const float quaternion[4] = {q.x, q.y, q.z, q.w};
  for (float& s : deviations) s = expf(s);
  out.f = project(frame.camera, out.mean, deviations, quaternion);
  out.opacity = 1.0f / (1.0f + expf(-g.logit_opacities[i]));
  out.fade = frame.antialiased ? sqrtf(out.f.det_sharp / out.f.det) : 1.0f;
  return out;
}

/// The warp fetches the coefficients in use of its threads' Gaussians, of those who want them: a
/// row at a time, so that the reads are of memory in a row. The caller waits by
/// __pipeline_wait_prior and __syncwarp.
__device__ inline void fetch_sh(const GaussianPointers& g, int degree, bool wanted, std::uint32_t i,
                                float* rows) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const int used = 3 * sh_rest_used(degree);
  for (unsigned left = __ballot_sync(kAllLanes, wanted); left != 0; left &= left - 1) {
    const int from = __ffs(static_cast<int>(left)) - 1;
    const std::int64_t row = __shfl_sync(kAllLanes, i, from);
    const float* const source = g.sh_rest + row * 3 * g.sh_rest_count;
    for (int k = lane; k < used; k += kWarp) {
      __pipeline_memcpy_async(rows + from * kShStride + k, source + k, sizeof(float));
    }
  }
  __pipeline_commit();
}

}  // namespace apvi::splat::cuda
