// SPDX-License-Identifier: BSD-3-Clause
// The rasterizer's inner loops for processors with AVX2 and FMA; compiled for x86-64-v3.
#include "kernel_table.hpp"
#include "simd_avx2.hpp"

namespace apvi::splat {

RasterKernels<float> avx2_kernels() {
  return kernels_on<simd::Float8>();
}

}  // namespace apvi::splat
