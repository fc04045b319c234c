// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>

#include "apvi/mapping/rendering.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// Standard deviations of where a camera is thought to stand.
struct PoseSigmas {
  double translation_m = 0.02;
  double rotation_rad = 0.005;
};

/// A camera's place as its picture and the map have it.
struct PictureAlignment {
  torch::Tensor T_camera_believed;  ///< [4,4] float64: from where it was thought to be
  double before = 0.0;              ///< mean residual, grey levels of 0 to 1, where it was thought
  double after = 0.0;               ///< and where it is
  double likeness = 0.0;            ///< correlation of the pictures less their local means, there
  double share = 0.0;               ///< of the picture that could be compared
};

/// Where `picture` [H,W,3] was taken, given what the map shows from where it is thought to be
/// (`shown`, drawn for a camera of `intrinsics`, which is the picture's): the most probable motion
/// when pictures differ by noise with outliers and the believed place errs by `sigmas`. Pictures
/// are compared without their local mean, and up to a factor, so that light and veil matter little.
///
/// Direct alignment, inverse compositional, coarse to fine, with robust weights (Baker and
/// Matthews, Lucas-Kanade 20 years on, 2004; Kerl et al., Robust odometry estimation for RGB-D
/// cameras, 2013). None when too little of the picture is on the map, or nothing fits better than
/// before; far off, when it is not much that fits better.
std::optional<PictureAlignment> align_picture(const Picture& shown, const torch::Tensor& picture,
                                              const splat::Intrinsics& intrinsics,
                                              const PoseSigmas& sigmas);

}  // namespace apvi::mapping
