// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <vector>

#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Exposure and white balance of restored images for viewing: one factor per channel for a whole
/// map, so that its images can be compared. A map alone does not determine them: the light at the
/// surface of the water and the color of the scene are unknown.
struct DisplayExposure {
  double brightness = 1.0;
  std::array<double, 3> balance = {1.0, 1.0, 1.0};  ///< RGB

  std::array<double, 3> gains() const {
    return {brightness * balance[0], brightness * balance[1], brightness * balance[2]};
  }
};

/// Chooses both from restored renderings of `views` (up to 16 of them, evenly spread), where they
/// show a surface through enough of the direct light:
/// - White balance: shades of gray (Finlayson and Trezzi, 2004): the means of the sixth powers of
///   the channels become equal. That lies between gray world and brightest neutral. A channel
///   changes by a factor of 2 at most.
/// - Brightness: all but 0.5 % of these pixels stay below full brightness.
/// `white_balance` false: only the brightness. Without a surface in any view, all factors are one.
DisplayExposure display_exposure(const Map& map, const std::vector<gaussians::View>& views,
                                 bool white_balance = true);

/// The light of a restored image [H,W,3] times the factors.
torch::Tensor exposed(const torch::Tensor& restored, const DisplayExposure& exposure);

/// A restored image [H,W,3] for viewing: light times the factors, as image values. Light above 0.8
/// is compressed smoothly below 1, so that bright and distant surfaces keep some contrast instead
/// of clipping.
torch::Tensor displayed(const torch::Tensor& restored, const DisplayExposure& exposure,
                        const gaussians::ToneCurve& curve);

}  // namespace apvi::mapping
