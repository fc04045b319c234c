// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "gaussians/render/view.hpp"
#include "medium/medium.hpp"

namespace apvi::medium {

/// The medium in front of one camera. Per-camera terms are computed once and shared by all its
/// images while the medium stays the same.
class MediumView {
 public:
  /// `medium` must have the type and device of the rendered images.
  MediumView(const Medium& medium, const gaussians::Intrinsics& camera);

  /// The same camera with slightly changed parameters; the lamp backscatter is not recomputed.
  MediumView with(const Medium& medium) const;

  /// Illumination [N,3] of the Gaussians at `means` [N,3] from a camera at `T_camera_world` [4,4]
  /// (float64, CPU), for RenderOptions::light; undefined without a lamp. Computed per Gaussian, so
  /// floaters in front of a surface do not change the illumination of the surface. Not recorded by
  /// autograd.
  torch::Tensor illumination_at(const torch::Tensor& means,
                                const torch::Tensor& T_camera_world) const;

  /// The observed image: a rendering (`color` [H,W,3] rendered with `illumination_at`, `depth`
  /// [H,W] along the optical axis, `alpha` [H,W]) with the medium and the lamp backscatter applied.
  /// Differentiable in color, depth, alpha and the medium's beta_d, beta_b, b_inf.
  torch::Tensor apply(const torch::Tensor& color, const torch::Tensor& depth,
                      const torch::Tensor& alpha) const;

  /// The image of open water, with nothing rendered: [H,W,3]; computed once. Not recorded by
  /// autograd.
  torch::Tensor open_water() const;

  bool has_lamp() const { return medium_.lamp.has_value(); }

 private:
  Medium medium_;  ///< lamp tensors on the device, too
  MediumViewData view_data_;
  mutable torch::Tensor open_water_;  ///< undefined until it is needed
};

}  // namespace apvi::medium
