// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

/// Launchers of the kernels of depth estimation: pointers to device memory, sizes, a stream, and
/// nothing of LibTorch. They return what the launch reported. What they compute is what
/// cpu_fallback/mapping computes, but for the order of sums.
namespace apvi::mapping::cuda {

inline constexpr int kDepthLevels = 6;     ///< reductions of a picture
inline constexpr int kMostViews = 32;      ///< pictures in one sweep
inline constexpr int kMostLabels = 1024;   ///< hypotheses that a node of belief propagation has
inline constexpr int kPlanesPerPixel = 2;  ///< of a smoother: values, weights
inline constexpr int kLongestLine = 6144;  ///< [px] that a smoother solves

/// A picture in one reduction, 1/256 grey levels; each word holds a pixel (low half) and the one
/// below it. Without pixels where the picture would be too small.
struct PictureLevel {
  const std::uint32_t* pairs;
  int width;
  int height;
};

struct PicturePyramid {
  PictureLevel levels[kDepthLevels];
  int count;  ///< levels that there are
};

/// One picture on its way from one reduction to the next; [height,width] is what comes out.
struct ReductionJob {
  const float* from;
  int from_width;
  float* to;  ///< the same, in 1/256 grey levels, for the next reduction
  std::uint32_t* pairs;
  int width;
  int height;
};

/// The same reduction of all pictures.
struct ReductionJobs {
  ReductionJob jobs[kMostViews + 1];
  int count;
  bool halve;  ///< means of four pixels; else the pixels times `unit`
  float unit;
};
cudaError_t launch_reduction(const ReductionJobs& in, cudaStream_t stream);

/// As SweepInput; `views` pictures beside the reference, which comes first in `pyramids`.
struct SweepPointers {
  PicturePyramid pyramids[kMostViews + 1];
  int views;
  int points;
  int labels;
  const float* projections;     ///< [views,3,4]
  const float* places;          ///< [points,2]
  const std::int32_t* levels;   ///< [points]
  const float* inverse_depths;  ///< [points,labels] or [1,labels]
  bool shared_depths;           ///< whether all points have the same
  const float* slopes;          ///< [points,2]
  const float* rays;            ///< [3,3]
  const float* centers;         ///< [views,3]
  bool absolute;                ///< difference instead of correlation
  int counted[kMostViews + 1];  ///< pictures that count, by how many see a point
  float noise;                  ///< 1/256 grey levels
  float patch_sigma;            ///< the same
  double beta_d, beta_b, b_inf;
};

/// `cost` and `seen` [points,labels].
cudaError_t launch_sweep(const SweepPointers& in, float* cost, std::uint8_t* seen,
                         cudaStream_t stream);

/// As BeliefInput.
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

/// One iteration: from `messages` [edges,labels] to `next`.
cudaError_t launch_messages(const GraphPointers& in, const float* messages, float* next,
                            cudaStream_t stream);
/// Cost plus the mean of two rounds of messages: `belief` [nodes,labels].
cudaError_t launch_beliefs(const GraphPointers& in, const float* a, const float* b, float* belief,
                           cudaStream_t stream);

/// As SurfaceInput and Surfaces.
struct SurfacePointers {
  int nodes;
  const float* inverse_depths;    ///< [nodes]
  const float* places;            ///< [nodes,2]
  const std::int32_t* offsets;    ///< [nodes+1]
  const std::int32_t* neighbors;  ///< [edges]
  double same;
  double steepest;
  float* agreement;  ///< [nodes]
  float* slope;      ///< [nodes,2]
};
cudaError_t launch_surfaces(const SurfacePointers& in, cudaStream_t stream);

/// Solves (1 + lambda A) u = f along all rows, or all columns, of `planes`
/// [kPlanesPerPixel,height,width] in place; `guide` is [height,width].
cudaError_t launch_smooth_lines(const float* guide, int height, int width, bool rows, float lambda,
                                float sigma, float* planes, cudaStream_t stream);

}  // namespace apvi::mapping::cuda
