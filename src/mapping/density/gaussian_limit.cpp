// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/gaussian_limit.hpp"

#include "gaussians/device.hpp"

namespace apvi::mapping {
namespace {

// Beyond this an optimization step is too slow for online mapping.
constexpr int kMaxGaussiansCpu = 100000;
// More overfit the noise of 640 x 480 images, and depth gets worse.
constexpr int kMaxGaussiansGpu = 600000;

}  // namespace

int gaussian_limit(const DensifyOptions& options) {
  if (options.max_gaussians > 0) return options.max_gaussians;
  return gaussians::active_device().is_cuda() ? kMaxGaussiansGpu : kMaxGaussiansCpu;
}

}  // namespace apvi::mapping
