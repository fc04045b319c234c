// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Kernel launchers of depth estimation: device pointers, sizes and a stream, independent of
/// LibTorch. They return the launch status. Results equal those of cpu_fallback/depth up to
/// summation order.
namespace apvi::depth::cuda {

inline constexpr int kDepthLevels = 6;       ///< pyramid levels of an image
inline constexpr int kMaxViews = 32;         ///< images in one sweep
inline constexpr int kMaxLabels = 1024;      ///< hypotheses per node of belief propagation
inline constexpr int kPlanesPerPixel = 2;    ///< of the smoother: values, weights
inline constexpr int kMaxLineLength = 6144;  ///< [px] of the smoother

/// A pyramid level in 1/256 gray levels; each word contains a pixel (low half) and the one below it
/// (high half). Empty where the image would be too small.
struct PyramidLevel {
  const std::uint32_t* pairs;
  int width;
  int height;
};

struct ImagePyramid {
  PyramidLevel levels[kDepthLevels];
  int count;  ///< levels
};

/// One image, from one pyramid level to the next; [height,width] is the output.
struct ReductionJob {
  const float* from;
  int from_width;
  float* to;  ///< output in 1/256 gray levels, the input of the next level
  std::uint32_t* pairs;
  int width;
  int height;
};

/// One pyramid level of all images.
struct ReductionJobs {
  ReductionJob jobs[kMaxViews + 1];
  int count;
  bool halve;  ///< averages four pixels; otherwise multiplies by `unit`
  float unit;
};
cudaError_t launch_reduction(const ReductionJobs& in, cudaStream_t stream);

/// As SweepInput; `views` images besides the reference, which is first in `pyramids`.
struct SweepPointers {
  ImagePyramid pyramids[kMaxViews + 1];
  int views;
  int points;
  int labels;
  const float* projections;     ///< [views,3,4]
  const float* places;          ///< [points,2]
  const std::int32_t* levels;   ///< [points]
  const float* inverse_depths;  ///< [points,labels] or [1,labels]
  bool shared_depths;           ///< whether all points share the hypotheses
  const float* slopes;          ///< [points,2]
  const float* rays;            ///< [3,3]
  const float* centers;         ///< [views,3]
  bool absolute;                ///< absolute difference instead of correlation
  int counted[kMaxViews + 1];   ///< number of averaged images, by number of observing images
  float noise;                  ///< 1/256 gray levels
  float patch_sigma;            ///< the same
  double beta_d, beta_b, b_inf;
};

/// `cost` and `seen` [points,labels].
cudaError_t launch_sweep(const SweepPointers& in, float* cost, std::uint8_t* seen,
                         cudaStream_t stream);

/// As BeliefPropagationInput.
struct GraphPointers {
  int nodes;
  int labels;
  const float* cost;              ///< [nodes,labels]
  const std::int32_t* offsets;    ///< [nodes+1]
  const std::int32_t* neighbors;  ///< [edges]
  const std::int32_t* reverse;    ///< [edges]
  const float* weights;           ///< [edges]
  float step;
  float limit;
};

/// One iteration, from `messages` [edges,labels] to `next`.
cudaError_t launch_messages(const GraphPointers& in, const float* messages, float* next,
                            cudaStream_t stream);
/// Cost plus the mean of two iterations of messages: `belief` [nodes,labels].
cudaError_t launch_beliefs(const GraphPointers& in, const float* a, const float* b, float* belief,
                           cudaStream_t stream);

/// As PlaneFitInput and FittedPlanes.
struct PlaneFitPointers {
  int nodes;
  const float* inverse_depths;    ///< [nodes]
  const float* places;            ///< [nodes,2]
  const std::int32_t* offsets;    ///< [nodes+1]
  const std::int32_t* neighbors;  ///< [edges]
  double max_relative_difference;
  double max_slope;
  float* agreement;  ///< [nodes]
  float* slope;      ///< [nodes,2]
};
cudaError_t launch_plane_fit(const PlaneFitPointers& in, cudaStream_t stream);

/// Solves (1 + lambda A) u = f along all rows or all columns of `planes`
/// [kPlanesPerPixel,height,width] in place; `guide` is [height,width].
cudaError_t launch_smooth_lines(const float* guide, int height, int width, bool rows, float lambda,
                                float sigma, float* planes, cudaStream_t stream);

}  // namespace apvi::depth::cuda
