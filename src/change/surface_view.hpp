// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "change/session.hpp"

namespace apvi::change {

/// The surface that a map shows in a view, without water; images are flat, n = H W.
struct SurfaceView {
  gaussians::View view;
  /// [n,3] tangent planes p: points P of the plane have p . P = 1 in the camera frame [1/m]; zero
  /// where no surface can be relied on.
  torch::Tensor planes;
  torch::Tensor color;    ///< [n,3] logarithm of the light, averaged over some pixels
  torch::Tensor detail;   ///< [n,2] band-passed logarithm of the brightness: coarse, fine
  torch::Tensor spread;   ///< [n] standard deviation of the Gaussians' depths, along the normal [m]
  torch::Tensor sigma{};  ///< [n] standard deviation of the surface along its normal [m]
};

/// The light that a map shows in a view, without water; n = H W.
struct ViewLight {
  torch::Tensor color;  ///< [n,3] logarithm of the light, averaged over some pixels
  torch::Tensor solid;  ///< [n] bool: alpha is at least 0.8
};
/// `black` is added to the light before the logarithm.
ViewLight view_light(const mapping::Map& map, const gaussians::View& view, double black);

/// Draws a surface view. The surface can be relied on where alpha is at least 0.8, the depth is
/// below three times the median, and the surface is seen at less than 76 degrees from its normal:
/// steeper ones are depth edges. The slopes of the planes are those
/// of inverse depth, which is linear in the pixels of a plane. `black` is added to the light before
/// the logarithm.
SurfaceView surface_view(const mapping::Map& map, const gaussians::View& view, double black);

/// Points [m,3] in the camera frame of the reliable pixels, and their pixels [m].
struct SurfacePixels {
  torch::Tensor pixels;
  torch::Tensor points;
};
SurfacePixels surface_pixels(const SurfaceView& view);

/// R [3,3] and t [3] of T_camera_world, like `like`.
struct CameraPose {
  torch::Tensor R, t;
};
CameraPose camera_pose(const gaussians::View& view, const torch::Tensor& like);

/// How points of the world lie to the surface in a view: only those whose pixel shows one.
struct Observation {
  torch::Tensor rows;      ///< [m] which of the points
  torch::Tensor pixels;    ///< [m] where they are
  torch::Tensor points;    ///< [m,3] in the camera frame [m]
  torch::Tensor distance;  ///< [m] to the tangent plane; positive between camera and surface [m]
  torch::Tensor normals;   ///< [m,3] of the plane, in the camera frame, away from the camera
};
Observation observation(const SurfaceView& view, const torch::Tensor& points);

}  // namespace apvi::change
