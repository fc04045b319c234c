// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>

#include "gaussians/render/view.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Standard deviations of a camera pose prior.
struct PoseSigmas {
  double translation_m = 0.02;
  double rotation_rad = 0.005;
};

/// Result of aligning an image to the map.
struct ImageAlignment {
  torch::Tensor T_camera_prior;  ///< [4,4] float64: motion from the prior pose
  double residual_before = 0.0;  ///< mean absolute residual at the prior pose, gray levels 0 to 1
  double residual_after = 0.0;   ///< the same at the aligned pose
  double correlation = 0.0;      ///< of the images minus their local means, at the aligned pose
  double overlap = 0.0;          ///< compared fraction of the image
};

/// Estimates the camera motion from the prior pose, at which `rendering` was rendered, to the pose
/// of `image` [H,W,3]; both have the same `intrinsics`. Maximum a posteriori with robust image
/// residuals and a prior of standard deviations `sigmas`. Local means are subtracted and a gain is
/// estimated, which makes it insensitive to illumination and veiling light.
///
/// Direct alignment, inverse compositional, coarse to fine (Baker and Matthews, Lucas-Kanade 20
/// years on, 2004; Kerl et al., Robust odometry estimation for RGB-D cameras, 2013). Returns
/// nothing when the overlap with the map is too small or the residual does not drop enough, which
/// has to be more after a large shift.
std::optional<ImageAlignment> align_image(const MapRendering& rendering, const torch::Tensor& image,
                                          const gaussians::Intrinsics& intrinsics,
                                          const PoseSigmas& sigmas);

}  // namespace apvi::mapping
