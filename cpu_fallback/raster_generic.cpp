// SPDX-License-Identifier: BSD-3-Clause
// The rasterizer's inner loops for any processor, and in double.
#include "kernel_table.hpp"
#include "simd_generic.hpp"

namespace apvi::splat {

RasterKernels<float> generic_float_kernels() {
  return kernels_on<simd::Pack<float, 8>>();
}
RasterKernels<double> generic_double_kernels() {
  return kernels_on<simd::Pack<double, 8>>();
}

}  // namespace apvi::splat
