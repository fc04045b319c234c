// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <string_view>

#include "apvi/mapping/open_water.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {

/// What a picture is compared with: as much light as the map has.
struct TargetInput {
  torch::Tensor picture;   ///< [H,W,3] uint8
  int reduction = 1;       ///< pixels each way that become one, those left over at the edge none
  torch::Tensor falloff;   ///< [h,w,1] of the lens; undefined: one
  torch::Tensor log_gain;  ///< [1] of the view; undefined: zero
};

/// How fast a gain goes to where a picture has it. What is solid in a map is a little too bright in
/// views that it has learned (2 % were seen) and too dark in a new one (3 to 7 % over new ground).
/// The map follows its gains, so either would run away with them: what views usually differ by is
/// the map's and stays out, and some of what was believed is forgotten each time.
struct GainPace {
  double share;    ///< of the difference of logarithms
  double most;     ///< of that difference that is believed
  double forgets;  ///< share of what was believed, each time
  double learns;   ///< share of what a difference says about the usual one
};
/// A new view's, of which nothing is known: glare takes a factor of three within a second.
inline constexpr GainPace kGainFound{.share = 1.0, .most = 3.0, .forgets = 0.02, .learns = 0.3};
/// One that is known, on the way: a picture that the map does not show yet shall not take it along.
inline constexpr GainPace kGainFollowed{
    .share = 0.05, .most = 0.5, .forgets = 0.002, .learns = 0.02};

/// What a view's gain is found with.
struct GainInput {
  torch::Tensor drawn;    ///< [H,W,3]
  torch::Tensor alpha;    ///< [H,W]
  torch::Tensor picture;  ///< [H,W,3] without the lens' falloff, with the gain
  torch::Tensor water;    ///< [H,W,3] what open water looks like; undefined: there is none
  Horizon horizon = kNoSky;
  torch::Tensor log_gain;  ///< [1] before, and in place after
  torch::Tensor usual;     ///< [1] what log gains usually differ by, in place
  GainPace pace = kGainFound;
};

/// What views have said about Gaussians [N] float32, in place.
struct SeenSums {
  torch::Tensor gradient;    ///< sum of the pull at the projected centre
  torch::Tensor views;       ///< number that saw it
  torch::Tensor max_weight;  ///< largest blend weight
};

/// What a step of training does besides drawing, comparing and Adam. A step on a GPU takes as long
/// as its launches are many, so each of these is one or two there; here they are LibTorch's
/// operators, which run anywhere. Except for `bentness` nothing is recorded by autograd.
class StepBackend {
 public:
  StepBackend() = default;
  StepBackend(const StepBackend&) = delete;
  StepBackend& operator=(const StepBackend&) = delete;
  virtual ~StepBackend() = default;

  virtual std::string_view name() const { return "operators"; }
  /// [h,w,3] float32, 0 to 1 before falloff and gain are divided out.
  virtual torch::Tensor target(const TargetInput& input) const;
  /// Where a picture of a keyframe [H,W,3] uint8 is as bright as it can be: bool [h,w,3].
  torch::Tensor saturated(const torch::Tensor& picture, int reduction) const;
  /// See ViewGains::find.
  virtual void match_gain(const GainInput& input) const;
  /// See mapping::water_kinds and mapping::opacity_pull.
  virtual torch::Tensor water_kinds(const torch::Tensor& picture, const torch::Tensor& water) const;
  virtual torch::Tensor opacity_pull(const torch::Tensor& picture, const torch::Tensor& water,
                                     const torch::Tensor& alpha,
                                     const OpacityWeights& weights) const;
  /// See DensityStatistics::observe.
  virtual void observe(const splat::RenderStatistics& statistics, const SeenSums& sums) const;
  /// See mapping::bentness; of pictures that are large enough.
  virtual torch::Tensor bentness(const torch::Tensor& depth, const torch::Tensor& alpha,
                                 const torch::Tensor& picture) const;
};

/// kernels/mapping/cuda_step.cpp, in builds with APVI_BACKEND=cuda; float32.
const StepBackend& cuda_step_backend();

/// The backend for tensors on `device`.
const StepBackend& step_backend(const torch::Device& device);

}  // namespace apvi::mapping
