// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "gaussians/render/tone_curve.hpp"
#include "gaussians/render/view.hpp"
#include "medium/medium_fit.hpp"

namespace apvi::mapping {

/// Pixels that may show open water: uniform regions not covered by the map, which may also be
/// unmapped surfaces, and uniform regions above the horizon, which the map may have covered with
/// Gaussians of the water's color.
class OpenWaterCandidates {
 public:
  /// Adds candidates of view `number` from its `image` [H,W,3] in linear light and the map's
  /// `alpha` [H,W], both on one device.
  void add(std::int64_t number, const gaussians::View& camera, const torch::Tensor& image,
           const torch::Tensor& alpha);

  /// Candidates that consistently show the water of `fit` in daylight, as one distant observation
  /// each, without lamp terms. Empty when they are too few or no majority. Prefers those above the
  /// horizon, because distant sand in backscatter looks similar.
  medium::Observations open_water(const medium::MediumFit& fit,
                                  const gaussians::ToneCurve& curve) const;

 private:
  std::vector<torch::Tensor> views_, corners2_, colors_, bare_, above_;
};

}  // namespace apvi::mapping
