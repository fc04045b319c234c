// SPDX-License-Identifier: BSD-3-Clause
// The rasterizer's inner loops for any processor, and in double.
#include "cpu_fallback/raster/kernel_table.hpp"
#include "cpu_fallback/raster/simd_generic.hpp"

namespace apvi::gaussians {

RasterKernels<float> generic_float_kernels() {
  return make_kernels<simd::Pack<float, 8>>();
}
RasterKernels<double> generic_double_kernels() {
  return make_kernels<simd::Pack<double, 8>>();
}

}  // namespace apvi::gaussians
