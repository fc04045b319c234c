// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "kernel_blend.hpp"
#include "kernel_project_backward.hpp"

namespace apvi::splat {

/// The rasterizer's inner loops on vectors V of simd_*.
template <typename V>
RasterKernels<typename V::Scalar> kernels_on() {
  return {&project_range<V>, &blend_tile<V>, &blend_tile_backward<V>, &project_range_backward<V>};
}

}  // namespace apvi::splat
