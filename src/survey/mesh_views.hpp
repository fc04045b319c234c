// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "mapping/rendering.hpp"
#include "survey/color_rule.hpp"
#include "survey/survey_view.hpp"

namespace apvi::survey {

/// Depth of the surface in a view [H,W] along the optical axis [m], on the device of the map: what
/// the map shows, changed as the view says. 0 where alpha is below kKnownAlpha, at depth edges,
/// beyond three times the median, and where the view confirms no surface.
torch::Tensor reliable_depth(const mapping::Map& map, const SurveyView& view);

/// The nearest pixels of an image [h,w] as one [height,width].
torch::Tensor resized(const torch::Tensor& image, std::int64_t height, std::int64_t width);

/// What a view contributes to a mesh, on the CPU.
struct MeshView {
  torch::Tensor color;  ///< [H,W,3] uint8
  torch::Tensor depth;  ///< [H,W] float32: `reliable_depth`
};
MeshView mesh_view(const mapping::Map& map, const SurveyView& view, const ColorRule& colors);

}  // namespace apvi::survey
