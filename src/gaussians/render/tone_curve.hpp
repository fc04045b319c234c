// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "gaussians/model/gaussians.hpp"

namespace apvi::gaussians {

/// How a camera turns light into image values. Light and values are in [0, 1], relative to full
/// brightness; both may leave this range, where the curve goes on.
///
///   value = (1 + offset) light^(1/gamma) - offset
///
/// and proportional to the light below a small threshold, so that the slope stays finite. The map,
/// the medium and exposure gains are in linear light; losses and errors are in image values.
struct ToneCurve {
  double gamma = 1.0;
  double offset = 0.0;

  bool is_linear() const { return gamma == 1.0; }
  bool operator==(const ToneCurve&) const = default;

  /// Image values of linear light, of any shape; differentiable.
  torch::Tensor encode(const torch::Tensor& light) const;
  /// Linear light of image values.
  torch::Tensor decode(const torch::Tensor& values) const;
  /// Derivative of the image value by the light, at linear light.
  torch::Tensor slope(const torch::Tensor& light) const;
  /// Exponent of the power of light that the curve is like at medium brightness.
  double exponent() const;
  /// Linear light of the byte values 0 to 255: [256] float32 on `device`. Undefined if linear.
  torch::Tensor byte_table(const torch::Device& device) const;
};

/// IEC 61966-2-1.
inline constexpr ToneCurve kSrgb{.gamma = 2.4, .offset = 0.055};

/// For archives: [2] float64. The second throws c10::Error for anything but a valid curve.
torch::Tensor to_tensor(const ToneCurve& curve);
ToneCurve tone_curve_of(const torch::Tensor& values);

/// The same Gaussians with colors in image values instead of linear light, to first order about
/// their mean color, as other programs expect them; and back.
Gaussians with_encoded_colors(const Gaussians& gaussians, const ToneCurve& curve);
Gaussians with_decoded_colors(const Gaussians& gaussians, const ToneCurve& curve);

}  // namespace apvi::gaussians
