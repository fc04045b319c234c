// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::splat {

/// The order [N] int64 in which points [N,3] lie along a Z-shaped curve through the cube around
/// them: neighbours in it are mostly neighbours in space, so that what is read of Gaussians in that
/// order lies close together in memory too (Morton, "A computer oriented geodetic data base",
/// 1966). Points of one cell of the cube, of 2^21 along each edge, keep their order; those that are
/// not finite count as zero. On the points' device.
torch::Tensor morton_order(const torch::Tensor& points);

}  // namespace apvi::splat
