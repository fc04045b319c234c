// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::splat {

/// A pinhole camera without distortion. The centre of the top-left pixel is at (0.5, 0.5): a
/// principal point taken from OpenCV's convention is 0.5 px less than here.
struct Intrinsics {
  double fx = 0.0;  ///< [px]
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  int width = 0;
  int height = 0;

  /// The same camera at another resolution.
  Intrinsics scaled(int new_width, int new_height) const;
};

/// A camera at a place. Camera frame: x right, y down, z forward.
struct View {
  Intrinsics intrinsics;
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU, maps world to camera
  /// [6] translation, then rotation vector, in the camera frame: the pose that is rendered is
  /// Exp(pose_delta) * T_camera_world (left perturbation). Undefined means zero; give zeros that
  /// require a gradient to get the derivative by the pose.
  torch::Tensor pose_delta;
};

}  // namespace apvi::splat
