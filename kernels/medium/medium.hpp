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

inline constexpr int kMaxLamps = 4;
/// The beam profile is exp(-(linear x + square x^2)) with x = 1 - cos(angle).
struct LampBeam {
  float position[3];  ///< in the camera frame [m]
  float axis[3];
  float linear;
  float square;
  float share;
};

/// Illumination of points by lamps, see LampLight.
struct LampPointers {
  std::int64_t count;
  const float* means;        ///< [count,3]
  const float* beta_d;       ///< [3]
  const float* daylight;     ///< [3]
  float T_camera_world[12];  ///< [3,4] row-major
  LampBeam lamps[kMaxLamps];
  int lamp_count;
  float unit_range_m;
  float nearest_m;
};
/// `light` [count,3].
cudaError_t launch_lamp_light(const LampPointers& in, float* light, cudaStream_t stream);

}  // namespace apvi::medium::cuda
