// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::change {

/// Colors of the same cells in two sessions, [n,3] logarithms of the light.
struct ColorPairs {
  torch::Tensor keys;    ///< [n] ascending, see `cell_keys`
  torch::Tensor points;  ///< [n,3] [m]
  torch::Tensor before, after;
  torch::Tensor support;  ///< [n] number of views in the dive that has fewer
};

/// What the other water, light and white balance of a session do not explain of its colors.
struct ColorResiduals {
  torch::Tensor residual;  ///< [n,3] logarithm of after / before as it should be
  torch::Tensor distance;  ///< [n] Mahalanobis distance from the noise
  torch::Tensor slope;     ///< [3] log after = slope log before + offset
  torch::Tensor offset;    ///< [3]
};

/// Robust transfer of colors between sessions: for each channel a line (reduced major axis of
/// median and median absolute deviation), then the medians of neighborhoods 3 m wide (lamps and
/// shade). The residuals are averaged over neighboring cells, within `radius_m`. Their noise is the
/// deviation of each channel in the neighborhood by what nine tenths of it are within, as fine
/// patterns differ more than sand, or that of cells with as many views, if it is larger; and the
/// correlation of the channels, of what is within three deviations.
ColorResiduals color_residuals(const ColorPairs& pairs, double cell_m, double radius_m);

}  // namespace apvi::change
