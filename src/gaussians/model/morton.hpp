// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::gaussians {

/// Of a Morton code, per axis: three fit into a signed 64-bit integer.
inline constexpr int kMortonBits = 21;

/// Morton codes [N] int64 of cells [N,3] int64, each coordinate from 0 to 2^kMortonBits - 1.
/// `code >> 3 k` is that of the cell 2^k times as large around it.
torch::Tensor morton_codes(const torch::Tensor& cells);

/// Order [N] int64 of points [N,3] along a Morton (Z-order) curve through their bounding cube
/// (Morton, "A computer oriented geodetic data base", 1966). Neighbors in it are mostly neighbors
/// in space, which improves memory locality of the Gaussians. Points in the same of 2^21 cells per
/// edge keep their order; non-finite points count as zero. On the points' device.
torch::Tensor morton_order(const torch::Tensor& points);

}  // namespace apvi::gaussians
