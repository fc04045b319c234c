// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launchers of the other kernels of a training step: device pointers, sizes and a stream, without
/// LibTorch. They return the launch error. They compute the same as
/// src/mapping/training/step_backend.cpp, except for the order of summation, which is
/// deterministic.
namespace apvi::mapping::cuda {

inline constexpr int kStepBlocks = 256;   ///< each writes a partial sum
inline constexpr int kGainSums = 3;       ///< rendered light, observed light, sum of weights
inline constexpr int kCurvatureSums = 2;  ///< sums per pass over the pixels

/// `target` [height,width,3] of bytes [reduction height + rest, full_width,3].
struct TargetPointers {
  const std::uint8_t* image;
  int full_width;
  int width, height;
  int reduction;
  const float* falloff;   ///< [height,width] or null
  const float* log_gain;  ///< [1] or null
  const float* light;     ///< [256] linear light of each byte, or null
};
cudaError_t launch_target(const TargetPointers& in, float* target, cudaStream_t stream);

struct GainPointers {
  int width, height;
  const float* rendered;       ///< [height,width,3]
  const float* alpha;          ///< [height,width]
  const float* image;          ///< [height,width,3]
  const float* water;          ///< [height,width,3] or null
  float across, down, offset;  ///< horizon line, see mapping::horizon
  float step_size;
  float max_change;
  float decay;
  float bias_rate;
  float* partials;  ///< [kStepBlocks,kGainSums] scratch
};
/// Updates `log_gain` [1] and `bias` [1] in place.
cudaError_t launch_match_gain(const GainPointers& in, float* log_gain, float* bias,
                              cudaStream_t stream);

struct WaterClassPointers {
  int width, height;
  const float* image;  ///< [height,width,3]
  const float* water;  ///< [height,width,3] appearance of open water
  std::int8_t* kinds;  ///< [height,width] out
};
cudaError_t launch_classify_water(const WaterClassPointers& in, cudaStream_t stream);

struct OpacityGradientPointers {
  int width, height;
  const std::int8_t* kinds;  ///< [height,width] output of launch_classify_water
  const float* alpha;        ///< [height,width]
  float open, edge, surface;
  float* gradient;  ///< [height,width] out
};
cudaError_t launch_opacity_loss_gradient(const OpacityGradientPointers& in, cudaStream_t stream);

struct ObservePointers {
  std::int64_t count;
  const bool* visible;
  const float* gradient;
  const float* weight;
  float* gradient_sum;
  float* views;
  float* max_weight;
};
cudaError_t launch_observe(const ObservePointers& in, cudaStream_t stream);

struct CurvaturePointers {
  int width, height;
  const float* depth;  ///< [height,width]
  const float* alpha;  ///< [height,width]
  const float* image;  ///< [height,width,3]
  float* inverse;      ///< [height,width] saved: inverse depth of opaque pixels, else 0
  float* gradients;    ///< [2,height,width] saved: unscaled derivative by each second difference
  float* factor;       ///< [1] saved: scale of the derivatives
  float* gray;         ///< [height,width] scratch
  float* partials;     ///< [2,kStepBlocks,kCurvatureSums] scratch
};
/// `loss` [1].
cudaError_t launch_depth_curvature_loss(const CurvaturePointers& in, float* loss,
                                        cudaStream_t stream);
/// `grad_loss` [1] scales `gradient` [height,width] by depth.
cudaError_t launch_depth_curvature_loss_backward(const CurvaturePointers& in,
                                                 const float* grad_loss, float* gradient,
                                                 cudaStream_t stream);

}  // namespace apvi::mapping::cuda
