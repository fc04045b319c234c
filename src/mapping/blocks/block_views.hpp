// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "gaussians/render/view.hpp"
#include "mapping/blocks/block_partition.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// World points [n,3] float64 on the CPU of the surface that a view shows, evenly spread over its
/// image; none where the map is not solid.
torch::Tensor surface_points(const Map& map, const gaussians::View& view);

/// Fraction [size()] float64 of `points` [n,3] in each block; zeros without points.
torch::Tensor block_shares(const BlockPartition& partition, const torch::Tensor& points);

/// Where `means` [n,3] are in the image of at least one of the views, or close to its border, bool
/// on their device.
torch::Tensor near_any_view(const torch::Tensor& means, const std::vector<gaussians::View>& views);

}  // namespace apvi::mapping
