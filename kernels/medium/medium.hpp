// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "gaussians/render/splat_math.hpp"

/// Kernel launchers of the medium model: device pointers, sizes and a stream, independent of
/// LibTorch. They return the launch status.
namespace apvi::medium::cuda {

/// Blocks of the backward pass; each writes one partial sum per scalar of the medium.
inline constexpr int kMediumBlocks = 256;
inline constexpr int kMediumScalars = 9;  ///< beta_d, beta_b, b_inf, RGB each

struct MediumPointers {
  int width, height;
  const float* color;        ///< [H,W,3]
  const float* depth;        ///< [H,W]
  const float* alpha;        ///< [H,W]
  const float* ray_lengths;  ///< [H,W] or null: one
  const float* beta_d;       ///< [3]
  const float* beta_b;       ///< [3]
  const float* b_inf;        ///< [3]
  gaussians::BackscatterTable<float> lamp_backscatter;
};

struct MediumGradientPointers {
  float* color;     ///< [H,W,3]
  float* depth;     ///< [H,W]
  float* alpha;     ///< [H,W]
  float* partials;  ///< [kMediumScalars,kMediumBlocks], scratch; or null: no scalars
  float* scalars;   ///< [kMediumScalars]
};

/// `image` [H,W,3].
cudaError_t launch_medium_forward(const MediumPointers& in, float* image, cudaStream_t stream);
/// Sums in a fixed order: the result is deterministic.
cudaError_t launch_medium_backward(const MediumPointers& in, const float* grad_image,
                                   const MediumGradientPointers& out, cudaStream_t stream);

/// Lamp illumination of points, see LampLight; the beam profile is exp(sharpness (cos(angle) - 1)).
struct LampPointers {
  std::int64_t count;
  const float* means;     ///< [count,3]
  const float* beta_d;    ///< [3]
  const float* daylight;  ///< [3]
  float from_lamp[12];    ///< world to lamp, in the camera's axes, [3,4] row-major
  float axis[3];
  float sharpness;
  float unit_range_m;
  float nearest_m;
};
/// `light` [count,3].
cudaError_t launch_lamp_light(const LampPointers& in, float* light, cudaStream_t stream);

}  // namespace apvi::medium::cuda
