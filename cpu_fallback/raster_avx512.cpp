// SPDX-License-Identifier: BSD-3-Clause
// The rasterizer's inner loops for processors with AVX-512; compiled for x86-64-v4.
#include "kernel_table.hpp"
#include "simd_avx512.hpp"

namespace apvi::splat {

RasterKernels<float> avx512_kernels() {
  return kernels_on<simd::Float16>();
}

}  // namespace apvi::splat
