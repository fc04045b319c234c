// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <optional>

#include "gaussians/model/gaussians.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "medium/medium.hpp"

namespace apvi::mapping {

/// Pixels of a view with depth, at which Gaussians are inserted.
struct Seeds {
  torch::Tensor pixels;     ///< [n,2] float64, u v; center of the first pixel at 0.5
  torch::Tensor depths;     ///< [n] float64 along the optical axis [m]
  torch::Tensor radii_px;   ///< [n] float64: sigma of the Gaussian in the image
  torch::Tensor opacities;  ///< [n] float64

  std::int64_t size() const { return depths.defined() ? depths.size(0) : 0; }
  /// Selects by indices [m] int64.
  Seeds select(const torch::Tensor& index) const;
  static Seeds join(const Seeds& a, const Seeds& b);
  static Seeds none();
};

/// Applies a rigid transform T [4,4] to points [n,3]; same dtype.
torch::Tensor transform_points(const torch::Tensor& T, const torch::Tensor& points);

/// Row-major index [n] int64 of the pixel at each position [n,2].
torch::Tensor pixel_index(const gaussians::Intrinsics& camera, const torch::Tensor& pixels);

/// World points projected to a view.
struct ProjectedPoints {
  torch::Tensor points;   ///< [n,3] float64 in the camera's frame [m]
  torch::Tensor pixels;   ///< [n,2] float64
  torch::Tensor depths;   ///< [n] float64 [m]
  torch::Tensor in_view;  ///< [n] bool: in front of the camera and inside the image
};
/// Projects `positions` [n,3] float64 [m].
ProjectedPoints project(const gaussians::View& view, const torch::Tensor& positions);

/// Back-projects pixels [n,2] with depths [n] to world points [n,3] float64.
torch::Tensor world_points(const gaussians::View& view, const torch::Tensor& pixels,
                           const torch::Tensor& depths);

/// Isotropic Gaussians at the seeds, float32 on the CPU, in the colors of the view's image divided
/// by the camera's `response` (see `camera_response`; undefined: one) and with the medium removed.
/// Seeds at pixels that do not show the scene are left out.
gaussians::Gaussians gaussians_from_seeds(const Seeds& seeds, const KeyframeStore& keyframes,
                                          std::size_t view, int sh_degree,
                                          const std::optional<medium::Medium>& medium,
                                          const torch::Tensor& response = {});

/// Removes the medium from observed colors [n,3] in [0, 1] of `points` [n,3] in the camera's frame.
torch::Tensor remove_medium(const torch::Tensor& colors, const torch::Tensor& points,
                            const medium::Medium& medium);

}  // namespace apvi::mapping
