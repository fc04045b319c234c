// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>

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
  /// Of the lens whose picture was made a pinhole's: squared distances from the middle were
  /// 1 + a t + b t^2 + c t^3 times as large there, with t = x^2 + y^2 of the ray (x, y, 1). Light
  /// falls off towards the corners of the lens's own picture.
  std::array<double, 3> lens_spread{};

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
