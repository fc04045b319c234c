// SPDX-License-Identifier: BSD-3-Clause
// The rasterizer's inner loops for processors with AVX2 and FMA; compiled for x86-64-v3.
#include "cpu_fallback/raster/kernel_table.hpp"
#include "cpu_fallback/raster/simd_avx2.hpp"

namespace apvi::gaussians {

RasterKernels<float> avx2_kernels() {
  return make_kernels<simd::Float8>();
}

}  // namespace apvi::gaussians
