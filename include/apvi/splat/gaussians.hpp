// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>

namespace apvi::splat {

/// Number of spherical-harmonics coefficients per colour channel beyond the constant one.
constexpr std::int64_t sh_rest_count(int degree) {
  return static_cast<std::int64_t>(degree + 1) * (degree + 1) - 1;
}
inline constexpr int kMaxShDegree = 3;

/// A map of N anisotropic 3-D Gaussians as an optimiser needs it, free of bounds (Kerbl et al., "3D
/// Gaussian splatting for real-time radiance field rendering", 2023). All tensors on one device and
/// of one floating type, contiguous; world coordinates in metres.
struct Gaussians {
  torch::Tensor means;            ///< [N,3] [m]
  torch::Tensor log_scales;       ///< [N,3] natural logarithm of the standard deviations [m]
  torch::Tensor quaternions;      ///< [N,4] w x y z, Gaussian to world; of any length but zero
  torch::Tensor logit_opacities;  ///< [N]
  torch::Tensor sh_dc;            ///< [N,3] constant coefficient, RGB
  torch::Tensor sh_rest;          ///< [N,K,3] the others, K = sh_rest_count(degree), degree 0 to 3

  std::int64_t size() const { return means.defined() ? means.size(0) : 0; }
  int sh_degree() const;

  /// In the order of the members: what an optimiser, a checkpoint or a device copy goes through.
  std::array<torch::Tensor*, 6> tensors() {
    return {&means, &log_scales, &quaternions, &logit_opacities, &sh_dc, &sh_rest};
  }
  std::array<const torch::Tensor*, 6> tensors() const {
    return {&means, &log_scales, &quaternions, &logit_opacities, &sh_dc, &sh_rest};
  }

  static Gaussians empty(int sh_degree, const torch::TensorOptions& options);
};

/// Derivatives of a loss by those Gaussians of a map that a picture shows, as a rasterizer has them
/// and a fused optimiser takes them; undefined tensors: none. In a form of the backend's own.
struct GaussianRows {
  torch::Tensor row;     ///< [N] int32: which row a Gaussian has; -1: none
  torch::Tensor values;  ///< [rows, ...]
  int sh_degree = 0;     ///< that was in use
};

/// Throws c10::Error naming the first tensor whose shape, type or device does not fit.
void check(const Gaussians& gaussians);

}  // namespace apvi::splat
