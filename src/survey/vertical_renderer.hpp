// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "survey/survey_map.hpp"

namespace apvi::survey {

/// Alpha from which a pixel shows a surface; below, nothing is known there.
inline constexpr double kKnownAlpha = 0.5;

/// Light [N,3] that the Gaussians of a map send straight up, not negative.
torch::Tensor light_from_above(const SurveyMap& map);

/// The ground from above.
struct GroundImage {
  torch::Tensor color;      ///< [H,W,3] float32, light without the medium; 0 where unknown
  torch::Tensor elevation;  ///< [H,W] float64: height of the surface [m]; NaN where unknown
  torch::Tensor known;      ///< [H,W] bool: alpha is at least kKnownAlpha
};

/// Flattened Gaussians and a pinhole camera that sees them as a parallel projection.
struct VerticalView {
  mapping::Map map;  ///< without a medium, in the frame of the camera
  gaussians::View view;
  double top_m = 0.0;     ///< height at depth 1, relative to the anchor of the renderer [m]
  double relief_m = 1.0;  ///< how much lower depth 1.5 is [m]

  torch::Tensor height(const torch::Tensor& depth) const {
    return top_m - 2.0 * relief_m * (depth - 1.0);
  }
};

/// Draws a map in parallel projection along the vertical.
///
/// EWA splatting (Zwicker et al., 2002) with the constant Jacobian of a parallel projection: a
/// Gaussian's footprint is the horizontal part of its covariance. The rasterizers know pinhole
/// cameras only. A flat Gaussian at (x, y) with standard deviations s is therefore handed to them
/// at (x d, y d, d) with s d: a pinhole at the origin sees it at x, y with s whatever its depth d.
/// So the projection is exact, and d in [1, 1.5] only orders the Gaussians from top to bottom.
/// Colors are those of the vertical viewing direction.
class VerticalRenderer {
 public:
  explicit VerticalRenderer(const SurveyMap& map);

  /// One tile of up to some thousand pixels a side; memory grows with its size and its Gaussians.
  GroundImage render(const GroundGrid& tile) const;
  /// What `render` draws: the Gaussians that reach the tile.
  VerticalView pinhole(const GroundGrid& tile) const;

 private:
  torch::Tensor near(const GroundGrid& tile) const;

  Eigen::Vector3d anchor_;
  torch::Tensor positions_;  ///< [N,3] float64: relative to the anchor [m]
  torch::Tensor sigmas_;     ///< [N,2] float64: of the footprint, the larger one first [m]
  torch::Tensor angles_;     ///< [N] float64: of its major axis, from east to south [rad]
  torch::Tensor opacities_;  ///< [N] logits
  torch::Tensor colors_;     ///< [N,3] as SH coefficients
  bool antialiased_;
};

}  // namespace apvi::survey
