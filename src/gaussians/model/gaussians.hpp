// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>

namespace apvi::gaussians {

/// Spherical harmonics coefficients per color channel beyond the constant one.
constexpr std::int64_t sh_rest_count(int degree) {
  return static_cast<std::int64_t>(degree + 1) * (degree + 1) - 1;
}
inline constexpr int kMaxShDegree = 3;

/// A map of N anisotropic 3D Gaussians in the unconstrained parametrization of the optimizer (Kerbl
/// et al., "3D Gaussian splatting for real-time radiance field rendering", 2023). All tensors on
/// one device and of one floating type, contiguous; world coordinates in meters.
struct Gaussians {
  torch::Tensor means;            ///< [N,3] [m]
  torch::Tensor log_scales;       ///< [N,3] natural logarithm of the standard deviations [m]
  torch::Tensor quaternions;      ///< [N,4] w x y z, Gaussian to world; any nonzero norm
  torch::Tensor logit_opacities;  ///< [N]
  torch::Tensor sh_dc;            ///< [N,3] constant coefficient, RGB
  torch::Tensor sh_rest;          ///< [N,K,3] the rest, K = sh_rest_count(degree), degree 0 to 3

  std::int64_t size() const { return means.defined() ? means.size(0) : 0; }
  int sh_degree() const;

  /// In the order of the members, for the optimizer, checkpoints and device copies.
  std::array<torch::Tensor*, 6> tensors() {
    return {&means, &log_scales, &quaternions, &logit_opacities, &sh_dc, &sh_rest};
  }
  std::array<const torch::Tensor*, 6> tensors() const {
    return {&means, &log_scales, &quaternions, &logit_opacities, &sh_dc, &sh_rest};
  }

  static Gaussians empty(int sh_degree, const torch::TensorOptions& options);
};

/// Sparse gradient of a loss: only for the Gaussians visible in an image, as the rasterizer
/// computes it and a fused optimizer consumes it; undefined tensors: none. The layout of `values`
/// is backend-specific.
struct SparseGradient {
  torch::Tensor row;     ///< [N] int32: row of each Gaussian in `values`; -1: none
  torch::Tensor values;  ///< [rows, ...]
  int sh_degree = 0;     ///< degree that was rendered
};

/// Throws c10::Error naming the first tensor with a wrong shape, type or device.
void check(const Gaussians& gaussians);

}  // namespace apvi::gaussians
