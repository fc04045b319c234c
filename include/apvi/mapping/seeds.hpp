// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <optional>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/medium.hpp"

namespace apvi::mapping {

/// Where a view says that there is surface: pixels with depth.
struct Seeds {
  torch::Tensor pixels;     ///< [n,2] float64, u v; centre of the first pixel at 0.5
  torch::Tensor depths;     ///< [n] float64 along the optical axis [m]
  torch::Tensor radii_px;   ///< [n] float64: one sigma of the Gaussian to be, in the image
  torch::Tensor opacities;  ///< [n] float64

  std::int64_t size() const { return depths.defined() ? depths.size(0) : 0; }
  /// Those of the given indices [m] int64.
  Seeds select(const torch::Tensor& index) const;
  static Seeds join(const Seeds& a, const Seeds& b);
  static Seeds none();
};

/// Points [n,3] after a motion T [4,4], of one type.
torch::Tensor moved(const torch::Tensor& T, const torch::Tensor& points);

/// Index [n] int64 of the pixel that holds each position [n,2] in the picture, row by row.
torch::Tensor pixel_index(const splat::Intrinsics& camera, const torch::Tensor& pixels);

/// Points of the world as one view sees them.
struct SeenPoints {
  torch::Tensor points;   ///< [n,3] float64 in the camera's frame [m]
  torch::Tensor pixels;   ///< [n,2] float64
  torch::Tensor depths;   ///< [n] float64 [m]
  torch::Tensor in_view;  ///< [n] bool: before the camera and inside the picture
};
/// `positions` [n,3] float64 [m].
SeenPoints project(const splat::View& view, const torch::Tensor& positions);

/// Points [n,3] float64 of the world at pixels [n,2] and depths [n] of a view.
torch::Tensor world_points(const splat::View& view, const torch::Tensor& pixels,
                           const torch::Tensor& depths);

/// Round Gaussians at the seeds in the colours that the view's picture has there over the camera's
/// `response` (see `camera_response`; undefined: one), without the water in front if there is any;
/// float32 on the CPU.
splat::Gaussians gaussians_at(const Seeds& seeds, const KeyframeStore& keyframes, std::size_t view,
                              int sh_degree, const std::optional<splat::Medium>& medium,
                              const torch::Tensor& response = {});

/// Colours [n,3] in [0, 1] of `points` [n,3] in the camera's frame seen through water, as the map
/// has them.
torch::Tensor without_water(const torch::Tensor& colors, const torch::Tensor& points,
                            const splat::Medium& medium);

}  // namespace apvi::mapping
