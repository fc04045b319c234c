// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>

#include "gaussians/render/view.hpp"

namespace apvi::gaussians {

/// A sphere around Gaussians [m].
struct Sphere {
  std::array<double, 3> center = {};
  double radius_m = 0.0;
};

/// In the camera's frame; T_camera_world [4,4] float64 on the CPU.
Sphere to_camera(const torch::Tensor& T_camera_world, const Sphere& in_world);
Sphere to_world(const torch::Tensor& T_camera_world, const Sphere& in_camera);

/// Whether a camera may see a part of the sphere, given in its frame, up to a distance of `far_m`.
/// Surfaces in between are not considered.
bool may_see(const Intrinsics& camera, const Sphere& in_camera, double far_m);

}  // namespace apvi::gaussians
