// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "depth/depth.hpp"
#include "depth/depth_backend.hpp"

namespace apvi::depth {

/// Throws c10::Error naming the first invalid view, counted from 0.
void check_views(const std::vector<DepthView>& views);

/// Geometry of the other cameras relative to the reference; see SweepInput.
struct SweepGeometry {
  torch::Tensor projections;  ///< [V,3,4] float32
  torch::Tensor rays;         ///< [3,3] float32
  torch::Tensor centers;      ///< [V,3] float32
  torch::Tensor sizes;        ///< [V,2] float32 width and height of the images [px]
  double baseline_m = 0.0;    ///< maximum
};
SweepGeometry sweep_geometry(const std::vector<DepthView>& views);
SweepGeometry on_device(const SweepGeometry& geometry, const torch::Device& device);

/// Inverse depths [1,L] from near to far.
torch::Tensor hypotheses(double near_m, double far_m, const DepthOptions& options);

/// Image motion of a point at inverse depth w [B] per unit of inverse depth: root mean square over
/// the images that observe it [px m], [B] float32.
torch::Tensor pixels_per_inverse_depth(const SweepGeometry& geometry, const torch::Tensor& points,
                                       const torch::Tensor& w);

}  // namespace apvi::depth
