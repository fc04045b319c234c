// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "apvi/mapping/depth.hpp"
#include "apvi/mapping/depth_backend.hpp"

namespace apvi::mapping {

/// Throws c10::Error naming the first view, counted from 0, that cannot be used.
void check_views(const std::vector<DepthView>& views);

/// How the other cameras see what the first one sees; see SweepInput.
struct SweepGeometry {
  torch::Tensor projections;  ///< [V,3,4] float32
  torch::Tensor rays;         ///< [3,3] float32
  torch::Tensor centers;      ///< [V,3] float32
  torch::Tensor sizes;        ///< [V,2] float32 width and height of the pictures [px]
  double baseline_m = 0.0;    ///< the longest
};
SweepGeometry sweep_geometry(const std::vector<DepthView>& views);
SweepGeometry on_device(const SweepGeometry& geometry, const torch::Device& device);

/// Inverse depths [1,L] from the nearest to the farthest.
torch::Tensor hypotheses(double near_m, double far_m, const DepthOptions& options);

/// How far a point at inverse depth w [B] moves in the other pictures when 1/depth changes by one:
/// the root of the mean square over those that see it [px m], [B] float32.
torch::Tensor pixels_per_inverse_depth(const SweepGeometry& geometry, const torch::Tensor& points,
                                       const torch::Tensor& w);

}  // namespace apvi::mapping
