// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace apvi::map_io {

/// Coefficients per channel beyond the constant one, at most: degree 3.
inline constexpr std::size_t kMaxRestCoefficients = 15;
/// Logit that stands for an opacity of one; its negative for zero.
inline constexpr float kOpaqueLogit = 20.0F;

/// Gaussians as plain numbers, in the parametrization of `gaussians::Gaussians`. The formats that
/// quantize are read and written without LibTorch.
struct Splats {
  std::size_t count = 0;
  std::size_t rest = 0;                ///< SH coefficients per channel beyond the constant one
  std::vector<float> means;            ///< [count,3] [m]
  std::vector<float> log_scales;       ///< [count,3]
  std::vector<float> quaternions;      ///< [count,4] w x y z
  std::vector<float> logit_opacities;  ///< [count]
  std::vector<float> sh_dc;            ///< [count,3]
  std::vector<float> sh_rest;          ///< [count,rest,3]

  Splats() = default;
  Splats(std::size_t size, std::size_t coefficients)
      : count(size),
        rest(coefficients),
        means(3 * size),
        log_scales(3 * size),
        quaternions(4 * size),
        logit_opacities(size),
        sh_dc(3 * size),
        sh_rest(3 * size * coefficients) {}
};

}  // namespace apvi::map_io
