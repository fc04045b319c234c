// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "cpu_fallback/raster/kernel_blend.hpp"
#include "cpu_fallback/raster/kernel_project_backward.hpp"

namespace apvi::gaussians {

/// The rasterizer's inner loops for vectors V of simd_*.
template <typename V>
RasterKernels<typename V::Scalar> make_kernels() {
  return {&project_range<V>, &blend_tile<V>, &blend_tile_backward<V>, &project_range_backward<V>};
}

}  // namespace apvi::gaussians
