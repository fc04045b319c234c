// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "gaussians/render/view.hpp"

namespace apvi::survey {

/// A view of the map, and what its image says about the map's depth.
struct SurveyView {
  gaussians::View camera;
  /// [h,w] float16 on the CPU, for a coarser image of the view: relative change from the depth that
  /// the map shows to that of the surface, NaN where the image confirms no surface. Undefined: the
  /// map's depth counts.
  torch::Tensor depth_change = {};
};

/// The cameras alone.
std::vector<gaussians::View> cameras_of(const std::vector<SurveyView>& views);

/// Indices of up to `count` other views to compare with `reference`, best first: those that have
/// the points [n,3] in their image, under a parallax of some degrees. Mean over the points of a
/// weight that rises up to kBestParallax and falls slowly beyond (as in Yao et al., "MVSNet",
/// 2018).
std::vector<std::size_t> comparison_views(const std::vector<gaussians::View>& views,
                                          std::size_t reference, const torch::Tensor& points,
                                          std::size_t count);

}  // namespace apvi::survey
