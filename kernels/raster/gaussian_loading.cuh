// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_pipeline_primitives.h>

#include "gaussians/render/sh_math.hpp"
#include "kernels/common/warp.cuh"
#include "kernels/raster/raster.hpp"

/// Loading of Gaussian parameters, shared by the projection and its backward pass.
namespace apvi::gaussians::cuda {

/// Floats per row of coefficients in shared memory; odd, to avoid bank conflicts when threads read
/// their own rows.
inline constexpr int kShStride = 3 * kMaxShRest;

/// Values of a Gaussian that both passes need.
struct ProjectedGaussian {
  float mean[3];
  Projection<float> f;
  float opacity;        ///< opacity parameter
  float opacity_scale;  ///< anti-aliasing factor
};

__device__ inline void load3(const float* from, std::int64_t i, float* to) {
  for (int k = 0; k < 3; ++k) to[k] = from[3 * i + k];
}

__device__ inline ProjectedGaussian project_gaussian(const GaussianPointers& g, const Frame& frame,
                                                     std::int64_t i) {
  ProjectedGaussian out;
  float scales[3];
  load3(g.means, i, out.mean);
  load3(g.log_scales, i, scales);
  const float4 q = reinterpret_cast<const float4*>(g.quaternions)[i];
  const float quaternion[4] = {q.x, q.y, q.z, q.w};
  for (float& s : scales) s = expf(s);
  out.f = project(frame.camera, out.mean, scales, quaternion);
  out.opacity = 1.0f / (1.0f + expf(-g.logit_opacities[i]));
  out.opacity_scale = frame.antialiased ? sqrtf(out.f.det_orig / out.f.det) : 1.0f;
  return out;
}

/// The warp loads the SH coefficients in use for its threads' Gaussians where `wanted`, one row at
/// a time for coalesced reads. The caller waits with __pipeline_wait_prior and __syncwarp.
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

}  // namespace apvi::gaussians::cuda
