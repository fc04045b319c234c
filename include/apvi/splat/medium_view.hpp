// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/splat/medium.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::splat {

/// Water as one camera looks through it. What all its pictures have in common is worked out once,
/// so one of these serves for as many as there are while the water stays what it is.
class MediumView {
 public:
  /// `medium` of the type and on the device of what is drawn.
  MediumView(const Medium& medium, const Intrinsics& camera);

  /// The same camera in water that has changed a little: what a lamp's light does on its way
  /// through the water before the camera stays as it was worked out.
  MediumView with(const Medium& medium) const;

  /// The light that falls on the Gaussians at `means` [N,3] while the camera is at
  /// `T_camera_world` [4,4] (float64, CPU), for RenderOptions::light: [N,3]; undefined without a
  /// lamp. Each has its own, so that what drifts before a surface does not change the surface's
  /// light. Not recorded by autograd.
  torch::Tensor light_on(const torch::Tensor& means, const torch::Tensor& T_camera_world) const;

  /// What the camera sees of a rendering (`color` [H,W,3], drawn in the light there is, see
  /// `light_on`; `depth` [H,W] along the optical axis, `alpha` [H,W]): through the water, with what
  /// a lamp's light does in it. Differentiable in color, depth, alpha and the medium's beta_d,
  /// beta_b, b_inf.
  torch::Tensor see(const torch::Tensor& color, const torch::Tensor& depth,
                    const torch::Tensor& alpha) const;

  /// The same where nothing is drawn at all: [H,W,3]. Not recorded by autograd.
  torch::Tensor open_water() const;

  bool has_lamp() const { return medium_.lamp.has_value(); }

 private:
  Medium medium_;       ///< daylight and glow on the device, too
  WaterColumn column_;  ///< before the camera
};

}  // namespace apvi::splat
