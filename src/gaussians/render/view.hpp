// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>

namespace apvi::gaussians {

/// A pinhole camera without distortion. The center of the top-left pixel is (0.5, 0.5): principal
/// points in OpenCV's convention are smaller by 0.5 px.
struct Intrinsics {
  double fx = 0.0;  ///< [px]
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  int width = 0;
  int height = 0;
  /// Distortion of the original lens, for its vignetting: squared radii in its image were 1 + a t +
  /// b t^2 + c t^3 times as large, with t = x^2 + y^2 of the ray (x, y, 1). Vignetting depends on
  /// the radius in the original image.
  std::array<double, 3> lens_spread{};

  /// The same camera at another resolution.
  Intrinsics scaled(int new_width, int new_height) const;
};

/// A camera with a pose. Camera frame: x right, y down, z forward.
struct View {
  Intrinsics intrinsics;
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU, world to camera
  /// [6] translation, then rotation vector, in the camera frame: the rendered pose is
  /// Exp(pose_delta) * T_camera_world (left perturbation). Undefined means zero; pass zeros that
  /// require a gradient to get the derivative with respect to the pose.
  torch::Tensor pose_delta;
};

}  // namespace apvi::gaussians
