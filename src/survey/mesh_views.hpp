// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "mapping/rendering.hpp"
#include "survey/color_rule.hpp"

namespace apvi::survey {

/// Depth of the surface in a view [H,W] along the optical axis [m], on the device of the map; 0
/// where alpha is below kKnownAlpha, at depth edges, and beyond three times the median.
torch::Tensor reliable_depth(const mapping::Map& map, const gaussians::View& view);

/// What a view contributes to a mesh, on the CPU.
struct MeshView {
  torch::Tensor color;  ///< [H,W,3] uint8
  torch::Tensor depth;  ///< [H,W] float32: `reliable_depth`
};
MeshView mesh_view(const mapping::Map& map, const gaussians::View& view, const ColorRule& colors);

}  // namespace apvi::survey
