// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>

#include "gaussians/render/render.hpp"
#include "mapping/medium/open_water.hpp"

namespace apvi::mapping {

/// Input of the training target: an image in linear light with gain and falloff removed.
struct TargetInput {
  torch::Tensor image;       ///< [H,W,3] uint8
  int reduction = 1;         ///< downscale factor; incomplete blocks are cropped
  torch::Tensor falloff;     ///< [h,w,1] of the lens; undefined: one
  torch::Tensor log_gain;    ///< [1] of the view; undefined: zero
  torch::Tensor light = {};  ///< [256] linear light of each byte; undefined: proportional
};

/// Parameters of a gain update. A map renders systematically too bright in known views (about 2 %)
/// and too dark in new ones (3 to 7 % over unmapped ground). Since the map is optimized with the
/// gains, uncorrected updates would drift; so the usual difference is tracked as a bias and
/// subtracted, and the gains decay slowly.
struct GainUpdate {
  double step_size;   ///< fraction of the log gain difference that is applied
  double max_change;  ///< bound of the difference
  double decay;       ///< fraction of the log gain lost per update
  double bias_rate;   ///< fraction of a difference that updates the bias
};
/// For new views: glare can change the gain by a factor of three within a second.
inline constexpr GainUpdate kNewViewGainUpdate{
    .step_size = 1.0, .max_change = 3.0, .decay = 0.02, .bias_rate = 0.3};
/// For known views: images not yet represented by the map should hardly affect the gain.
inline constexpr GainUpdate kKnownViewGainUpdate{
    .step_size = 0.05, .max_change = 0.5, .decay = 0.002, .bias_rate = 0.02};
/// For images of a finished map, which has no usual difference from them.
inline constexpr GainUpdate kFinishedMapGainUpdate{
    .step_size = 1.0, .max_change = 3.0, .decay = 0.0, .bias_rate = 0.0};

/// Input of a gain update of one view.
struct GainInput {
  torch::Tensor drawn;  ///< [H,W,3]
  torch::Tensor alpha;  ///< [H,W]
  torch::Tensor image;  ///< [H,W,3] without falloff, with the gain
  torch::Tensor water;  ///< [H,W,3] open water; undefined: no medium
  Horizon horizon = kNoSky;
  torch::Tensor log_gain;  ///< [1] updated in place
  torch::Tensor bias;      ///< [1] usual log gain difference, updated in place
  GainUpdate update = kNewViewGainUpdate;
};

/// Accumulated statistics of Gaussians [N] float32, updated in place.
struct DensitySums {
  torch::Tensor gradient;    ///< sum of gradient norms of the projected mean
  torch::Tensor views;       ///< number of views that see it
  torch::Tensor max_weight;  ///< largest blend weight
};

/// Parts of a training step besides rendering, photometric loss and Adam. On a GPU the time of a
/// step depends on the number of launches, so the CUDA backend uses one or two per function; this
/// base class uses LibTorch operators on any device. Only `depth_curvature_loss` is differentiable.
class StepBackend {
 public:
  StepBackend() = default;
  StepBackend(const StepBackend&) = delete;
  StepBackend& operator=(const StepBackend&) = delete;
  virtual ~StepBackend() = default;

  virtual std::string_view name() const { return "operators"; }
  /// [h,w,3] float32, in [0, 1] before falloff and gain are divided out.
  virtual torch::Tensor target(const TargetInput& input) const;
  /// Saturated values [h,w,3] bool of a keyframe image [H,W,3] uint8.
  torch::Tensor saturated(const torch::Tensor& image, int reduction) const;
  /// See ViewGains::initialize.
  virtual void match_gain(const GainInput& input) const;
  /// See mapping::classify_water and mapping::opacity_loss_gradient.
  virtual torch::Tensor classify_water(const torch::Tensor& image,
                                       const torch::Tensor& water) const;
  virtual torch::Tensor opacity_loss_gradient(const torch::Tensor& image,
                                              const torch::Tensor& water,
                                              const torch::Tensor& alpha,
                                              const OpacityWeights& weights) const;
  /// See DensityStatistics::observe.
  virtual void observe(const gaussians::RenderStatistics& statistics,
                       const DensitySums& sums) const;
  /// See mapping::depth_curvature_loss; for large enough images.
  virtual torch::Tensor depth_curvature_loss(const torch::Tensor& depth, const torch::Tensor& alpha,
                                             const torch::Tensor& image) const;
};

/// kernels/training/cuda_step.cpp, in builds with APVI_BACKEND=cuda; float32.
const StepBackend& cuda_step_backend();

/// The backend for tensors on `device`.
const StepBackend& step_backend(const torch::Device& device);

}  // namespace apvi::mapping
