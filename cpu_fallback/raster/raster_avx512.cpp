// SPDX-License-Identifier: BSD-3-Clause
// The rasterizer's inner loops for processors with AVX-512; compiled for x86-64-v4.
#include "cpu_fallback/raster/kernel_table.hpp"
#include "cpu_fallback/raster/simd_avx512.hpp"

namespace apvi::gaussians {

RasterKernels<float> avx512_kernels() {
  return make_kernels<simd::Float16>();
}

}  // namespace apvi::gaussians
