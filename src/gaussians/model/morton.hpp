// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::gaussians {

/// Order [N] int64 of points [N,3] along a Morton (Z-order) curve through their bounding cube
/// (Morton, "A computer oriented geodetic data base", 1966). Neighbors in it are mostly neighbors
/// in space, which improves memory locality of the Gaussians. Points in the same of 2^21 cells per
/// edge keep their order; non-finite points count as zero. On the points' device.
torch::Tensor morton_order(const torch::Tensor& points);

}  // namespace apvi::gaussians
