// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <Eigen/Core>
#include <vector>

#include "change/deformation_field.hpp"
#include "change/surface_cells.hpp"

namespace apvi::change {

/// The motion that takes points of the later session to the earlier one: a small rigid motion, then
/// a smooth deformation.
struct Registration {
  torch::Tensor R = torch::eye(3, torch::kFloat64);      ///< on the CPU
  torch::Tensor t = torch::zeros({3}, torch::kFloat64);  ///< [m]
  DeformationField deformation;
  double residual_m = 0.0;     ///< robust standard deviation of the distances that are left
  double shift_m = 0.0;        ///< median length of the displacements of the surface
  double deformation_m = 0.0;  ///< median length of the deformation's part, without its mean
  std::int64_t cells = 0;      ///< of the later surface, seen by the earlier session too

  torch::Tensor to_before(const torch::Tensor& points) const;
  /// The inverse, up to the deformation's change over its own length.
  torch::Tensor to_after(const torch::Tensor& points) const;
  /// T_before_after [4,4] float64 as it is near a point of the earlier session.
  torch::Tensor motion_at(const Eigen::Vector3d& point) const;
};

/// Aligns the later surface with the views of the earlier session by iteratively reweighted least
/// squares: distances to tangent planes (Chen and Medioni, 1992; projective association) and
/// differences in the details of the brightness, which also see horizontal shifts of flat ground
/// (after Park et al., Colored point cloud registration revisited, 2017). Tukey's weights leave out
/// what has changed; their range falls from 0.3 m to the noise. A rigid motion first, then a
/// deformation with nodes at 2 m whose neighbors differ by about 1 cm.
Registration align(const SurfaceCells& after, const std::vector<SurfaceView>& before,
                   const torch::Tensor& before_detail, const Progress& progress);

}  // namespace apvi::change
