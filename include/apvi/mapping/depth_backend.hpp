// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <limits>
#include <string_view>
#include <vector>

#include "apvi/mapping/depth_options.hpp"

namespace apvi::mapping {

/// Reductions of a picture that a block can be compared in: 1, 1/2, ... 1/32.
inline constexpr int kSweepLevels = 6;

/// Pictures as a backend wants them, in a shape of its own; the reference is the first.
struct SweepPictures {
  std::vector<torch::Tensor> kept;
};

/// Water as one grey channel sees it.
struct GreyMedium {
  double beta_d = 0.0;  ///< [1/m]; zeros: no water
  double beta_b = 0.0;
  double b_inf = 0.0;
};

/// What is compared with what. V other pictures, B points of the reference, L depths of each.
struct SweepInput {
  /// [V,3,4] float32, [K R K_ref^-1 | K t]: takes (x, y, 1, 1/depth) of the reference to the
  /// homogeneous pixel of the other picture times 1/depth.
  torch::Tensor projections;
  torch::Tensor points;          ///< [B,2] float32 (x, y) [px]
  torch::Tensor levels;          ///< [B] int32: reduction to look at least, 0 to kSweepLevels - 1
  torch::Tensor inverse_depths;  ///< [B,L], or [1,L] for all, float32 [1/m], monotonous
  torch::Tensor slopes;          ///< [B,2] float32 relative change of 1/depth [1/px]
  torch::Tensor rays;            ///< [3,3] float32 K_ref^-1; this and `centers` for water
  torch::Tensor centers;         ///< [V,3] float32 the other cameras, in the reference camera [m]
  PhotometricCost cost = PhotometricCost::zncc;
  double best_share = 1.0;  ///< as DepthOptions
  double noise = 0.0;
  double patch_sigma = std::numeric_limits<double>::infinity();  ///< as DepthOptions
  GreyMedium medium;
};

/// How many of the `seen` pictures that could see a point count. What lies behind bars or beside an
/// edge is hidden in some, and these would outvote the others (Kang, Szeliski and Chai, "Handling
/// occlusions in dense multi-view stereo", 2001); of few, all count.
int counted_views(int seen, double best_share);

struct SweepOutput {
  torch::Tensor cost;   ///< [B,L] float32 mean over the pictures that count, in [0, 1]
  torch::Tensor views;  ///< [B,L] uint8 how many see it; with none the cost is the point's mean
};

/// Blocks, what each thinks of every hypothesis, and who touches whom.
struct BeliefInput {
  torch::Tensor cost;       ///< [B,L] float32
  torch::Tensor offsets;    ///< [B+1] int32, as in BlockGraph
  torch::Tensor neighbors;  ///< [E] int32
  torch::Tensor reverse;    ///< [E] int32
  torch::Tensor weights;    ///< [E] float32: multiplies step and limit; the same both ways
  double step = 0.0;
  double limit = 0.0;
  int iterations = 0;
};

/// Depths of blocks, and who touches whom.
struct SurfaceInput {
  torch::Tensor inverse_depths;  ///< [B] float32 [1/m]
  torch::Tensor points;          ///< [B,2] float32 (x, y) [px]
  torch::Tensor offsets;         ///< [B+1] int32, as in BlockGraph
  torch::Tensor neighbors;       ///< [E] int32
  double same = 0.0;             ///< relative difference of 1/depth up to which it is one surface
  double steepest = 0.0;         ///< relative change of 1/depth that a surface may have [1/px]
};

/// What each block has in common with its neighbours.
struct Surfaces {
  torch::Tensor agreement;  ///< [B] float32 part of them that lie on the same surface; 1: has none
  /// [B,2] float32 relative change of 1/depth to the right and down [1/px]: the plane that fits
  /// those of the same surface best, drawn to a level one where they are few.
  torch::Tensor slope;
};

/// Edge-aware smoothing of values that are known here and there.
struct SmoothInput {
  torch::Tensor guide;    ///< [H,W] float32 in [0, 1]: its edges keep values apart
  torch::Tensor values;   ///< [H,W] float32
  torch::Tensor weights;  ///< [H,W] float32, 0 where the value is not known
  UpsampleOptions options;

  /// How strongly round 1 to `options.iterations` smooths: less and less, against streaks (Min et
  /// al., Eq. 9).
  float lambda(int round) const;
};

/// The seam between CPU and CUDA of all that costs time in depth estimation.
class DepthBackend {
 public:
  DepthBackend() = default;
  DepthBackend(const DepthBackend&) = delete;
  DepthBackend& operator=(const DepthBackend&) = delete;
  virtual ~DepthBackend() = default;

  virtual std::string_view name() const = 0;
  /// Makes pictures [H,W] float32 in [0, 1] ready for sweeps.
  virtual SweepPictures prepare(const std::vector<torch::Tensor>& greys) const = 0;
  /// Compares the surroundings of every point with the other pictures at every depth, those pixels
  /// most that look like the point (Schönberger et al., "Pixelwise view selection for unstructured
  /// multi-view stereo", 2016: what lies beside an edge would get the depth before it). Where the
  /// neighbouring depth is more than a pixel away, both are looked at in a reduction in which it is
  /// not, so that no minimum falls between two hypotheses.
  virtual SweepOutput sweep(const SweepPictures& pictures, const SweepInput& input) const = 0;
  /// Min-sum belief propagation, all nodes at once in every iteration (Felzenszwalb and
  /// Huttenlocher, "Efficient belief propagation for early vision", 2006): cost plus all messages
  /// [B,L], the mean of those of the last two iterations; the paper's B_u(d) with V in the place of
  /// the misprinted I.
  virtual torch::Tensor propagate(const BeliefInput& input) const = 0;
  virtual Surfaces surfaces(const SurfaceInput& input) const = 0;
  /// [2,H,W]: values, and weights, smoothed alike (Min et al., "Fast global image smoothing based
  /// on weighted least squares", 2014).
  virtual torch::Tensor smooth(const SmoothInput& input) const = 0;
};

/// cpu_fallback/mapping; the same bits with any number of threads.
const DepthBackend& cpu_depth_backend();
/// kernels/mapping/cuda_depth.cpp; only in builds for CUDA.
const DepthBackend& cuda_depth_backend();

/// The backend for tensors on `device`. Throws c10::Error for one this build has no backend for.
const DepthBackend& depth_backend(const torch::Device& device);

}  // namespace apvi::mapping
