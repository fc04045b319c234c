// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "gaussians/render/tone_curve.hpp"
#include "mapping/appearance/display_exposure.hpp"

namespace apvi::survey {

/// How the light of surfaces becomes the colors of a product: restored, with one exposure and white
/// balance for all of it, or attenuated by the medium.
struct ColorRule {
  mapping::DisplayExposure exposure{};
  gaussians::ToneCurve curve{};
  /// [3] exp(-beta_d range): what the medium leaves of the light. Undefined: restored colors.
  torch::Tensor transmission{};

  /// Image values in [0, 1] of light [...,3].
  torch::Tensor operator()(const torch::Tensor& light) const;
};

}  // namespace apvi::survey
