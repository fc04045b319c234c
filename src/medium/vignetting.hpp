// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::medium {

/// Vignetting of a lens, the same in all channels: the fraction exp(-(a s + b s^2)) of the light
/// arrives at a squared distance s from the principal point, 1 in a corner of the image. The even
/// polynomial (Goldman, "Vignette and exposure calibration and compensation", PAMI 32 (12), 2010)
/// is one of logarithms here, so that it stays positive and is independent of exposure gains. It
/// follows the natural falloff cos^4 of a camera of 80 degrees within 1 %.
struct Vignetting {
  double square = 0.0;  ///< a
  double fourth = 0.0;  ///< b

  bool is_none() const { return square == 0.0 && fourth == 0.0; }
  /// Factor at squared distances of any shape.
  torch::Tensor factor(const torch::Tensor& corners2) const;
  /// The nearest vignetting that darkens toward the corners and leaves some light there.
  Vignetting confined() const;
};

}  // namespace apvi::medium
