// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <limits>
#include <string_view>
#include <vector>

#include "apvi/depth/options.hpp"

namespace apvi::depth {

/// Pyramid levels of an image: scales 1, 1/2, ... 1/32.
inline constexpr int kSweepLevels = 6;

/// Image pyramids in a backend's own format; the reference first.
struct SweepImages {
  std::vector<torch::Tensor> pyramids;
};

/// The medium in the gray channel.
struct GrayMedium {
  double beta_d = 0.0;  ///< [1/m]; zeros: no medium
  double beta_b = 0.0;
  double b_inf = 0.0;
};

/// Inputs of a plane sweep. V other images, B points in the reference, L hypotheses per point.
struct SweepInput {
  /// [V,3,4] float32, [K R K_ref^-1 | K t]: maps (x, y, 1, 1/depth) of the reference to the
  /// homogeneous pixel of the other image, divided by depth.
  torch::Tensor projections;
  torch::Tensor points;          ///< [B,2] float32 (x, y) [px]
  torch::Tensor levels;          ///< [B] int32 finest pyramid level, 0 to kSweepLevels - 1
  torch::Tensor inverse_depths;  ///< [B,L], or [1,L] for all, float32 [1/m], monotonic
  torch::Tensor slopes;          ///< [B,2] float32 relative change of 1/depth [1/px]
  torch::Tensor rays;            ///< [3,3] float32 K_ref^-1; this and `centers` are for the medium
  torch::Tensor centers;         ///< [V,3] float32 other camera centers in the reference frame [m]
  PhotometricCost cost = PhotometricCost::zncc;
  double best_share = 1.0;  ///< as DepthOptions
  double noise = 0.0;
  double patch_sigma = std::numeric_limits<double>::infinity();  ///< as DepthOptions
  GrayMedium medium;
};

/// Number of best-matching images, of `seen` images that observe a point, whose costs are averaged.
/// The others may be occluded (Kang, Szeliski and Chai, "Handling occlusions in dense multi-view
/// stereo", 2001); of few, all are used.
int best_view_count(int seen, double best_share);

struct SweepOutput {
  torch::Tensor cost;  ///< [B,L] float32 mean over the best images, in [0, 1]
  torch::Tensor
      views;  ///< [B,L] uint8 images that observe the hypothesis; if 0, cost is the point's mean
};

/// Graph of blocks with a cost per hypothesis.
struct BeliefPropagationInput {
  torch::Tensor cost;       ///< [B,L] float32
  torch::Tensor offsets;    ///< [B+1] int32, as in BlockGraph
  torch::Tensor neighbors;  ///< [E] int32
  torch::Tensor reverse;    ///< [E] int32
  torch::Tensor weights;    ///< [E] float32 symmetric factors of step and limit
  double step = 0.0;
  double limit = 0.0;
  int iterations = 0;
};

/// Graph of blocks with an inverse depth each.
struct PlaneFitInput {
  torch::Tensor inverse_depths;          ///< [B] float32 [1/m]
  torch::Tensor points;                  ///< [B,2] float32 (x, y) [px]
  torch::Tensor offsets;                 ///< [B+1] int32, as in BlockGraph
  torch::Tensor neighbors;               ///< [E] int32
  double max_relative_difference = 0.0;  ///< relative difference of 1/depth within one surface
  double max_slope = 0.0;                ///< relative change of 1/depth of a surface [1/px]
};

/// Local planes fitted to each block and its neighbors.
struct FittedPlanes {
  torch::Tensor
      agreement;  ///< [B] float32 fraction of neighbors on the same surface; 1 without any
  /// [B,2] float32 relative change of 1/depth along x and y [1/px]: least-squares plane through the
  /// neighbors on the same surface, regularized toward fronto-parallel.
  torch::Tensor slope;
};

/// Edge-aware smoothing of sparse values.
struct SmoothInput {
  torch::Tensor guide;    ///< [H,W] float32 in [0, 1], its edges limit smoothing
  torch::Tensor values;   ///< [H,W] float32
  torch::Tensor weights;  ///< [H,W] float32, 0 where the value is unknown
  UpsampleOptions options;

  /// Smoothing strength of iteration 1 to `options.iterations`, decreasing to avoid streaks (Min et
  /// al., Eq. 9).
  float lambda(int round) const;
};

/// Interface of the CPU and CUDA implementations of depth estimation.
class DepthBackend {
 public:
  DepthBackend() = default;
  DepthBackend(const DepthBackend&) = delete;
  DepthBackend& operator=(const DepthBackend&) = delete;
  virtual ~DepthBackend() = default;

  virtual std::string_view name() const = 0;
  /// Builds pyramids of images [H,W] float32 in [0, 1].
  virtual SweepImages prepare(const std::vector<torch::Tensor>& grays) const = 0;
  /// Compares a patch around every point with the other images at every hypothesis. Pixels similar
  /// to the center have higher weights, against edge fattening (Schönberger et al., "Pixelwise view
  /// selection for unstructured multi-view stereo", 2016). Uses the pyramid level at which adjacent
  /// hypotheses are at most about a pixel apart, so no minimum is skipped.
  virtual SweepOutput sweep(const SweepImages& images, const SweepInput& input) const = 0;
  /// Min-sum belief propagation with synchronous updates (Felzenszwalb and Huttenlocher, "Efficient
  /// belief propagation for early vision", 2006): cost plus incoming messages [B,L], averaged over
  /// the last two iterations; the paper's B_u(d), with V in place of the misprinted I.
  virtual torch::Tensor propagate(const BeliefPropagationInput& input) const = 0;
  virtual FittedPlanes fit_planes(const PlaneFitInput& input) const = 0;
  /// [2,H,W]: smoothed values and weights (Min et al., "Fast global image smoothing based on
  /// weighted least squares", 2014).
  virtual torch::Tensor smooth(const SmoothInput& input) const = 0;
};

/// cpu_fallback/depth; bit-identical for any number of threads.
const DepthBackend& cpu_depth_backend();
/// kernels/depth/cuda_depth.cpp; only in CUDA builds.
const DepthBackend& cuda_depth_backend();

/// The backend for tensors on `device`. Throws c10::Error if this build has none for it.
const DepthBackend& depth_backend(const torch::Device& device);

}  // namespace apvi::depth
