// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launchers of what a training step does besides drawing, comparing and Adam: pointers to device
/// memory, sizes, a stream, and nothing of LibTorch. They return what the launch reported. What
/// they compute is what src/mapping/step_backend.cpp does with LibTorch's operators, but for the
/// order of sums, which is the same from run to run.
namespace apvi::mapping::cuda {

inline constexpr int kStepBlocks = 256;  ///< that leave a partial sum each
inline constexpr int kGainSums = 3;      ///< drawn light, the picture's, weights of the colours
inline constexpr int kBendSums = 2;      ///< of a pass over the pixels

/// `target` [height,width,3] of bytes [reduction height + rest, full_width,3].
struct TargetPointers {
  const std::uint8_t* picture;
  int full_width;
  int width, height;
  int reduction;
  const float* falloff;   ///< [height,width] or null
  const float* log_gain;  ///< [1] or null
};
cudaError_t launch_target(const TargetPointers& in, float* target, cudaStream_t stream);

struct GainPointers {
  int width, height;
  const float* drawn;          ///< [height,width,3]
  const float* alpha;          ///< [height,width]
  const float* picture;        ///< [height,width,3]
  const float* water;          ///< [height,width,3] or null
  float across, down, offset;  ///< of the horizon, see mapping::horizon
  float share;
  float most;
  float forgets;
  float learns;
  float* partials;  ///< [kStepBlocks,kGainSums] scratch
};
/// `log_gain` [1] and `usual` [1] in place.
cudaError_t launch_match_gain(const GainPointers& in, float* log_gain, float* usual,
                              cudaStream_t stream);

struct WaterPointers {
  int width, height;
  const float* picture;  ///< [height,width,3]
  const float* water;    ///< [height,width,3] what it looks like
  std::int8_t* kinds;    ///< [height,width] out
};
cudaError_t launch_water_kinds(const WaterPointers& in, cudaStream_t stream);

struct PullPointers {
  int width, height;
  const std::int8_t* kinds;  ///< [height,width] of water
  const float* alpha;        ///< [height,width]
  float open, edge, surface;
  float* pull;  ///< [height,width] out
};
cudaError_t launch_opacity_pull(const PullPointers& in, cudaStream_t stream);

struct SeenPointers {
  std::int64_t count;
  const bool* visible;
  const float* pull;
  const float* weight;
  float* gradient_sum;
  float* views;
  float* max_weight;
};
cudaError_t launch_observe(const SeenPointers& in, cudaStream_t stream);

struct BendPointers {
  int width, height;
  const float* depth;    ///< [height,width]
  const float* alpha;    ///< [height,width]
  const float* picture;  ///< [height,width,3]
  float* inverse;        ///< [height,width] kept: inverse depth of what is solid, else 0
  float* pulls;          ///< [2,height,width] kept: derivative by each second difference, unscaled
  float* factor;         ///< [1] kept: what those are to be multiplied with
  float* grey;           ///< [height,width] scratch
  float* partials;       ///< [2,kStepBlocks,kBendSums] scratch
};
/// `bent` [1].
cudaError_t launch_bend(const BendPointers& in, float* bent, cudaStream_t stream);
/// `by_bent` [1] is a factor of `gradient` [height,width] by depth.
cudaError_t launch_bend_backward(const BendPointers& in, const float* by_bent, float* gradient,
                                 cudaStream_t stream);

}  // namespace apvi::mapping::cuda
