// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "gaussians/render/view.hpp"

namespace apvi::survey {

/// Points in the image of a view.
struct Projection {
  torch::Tensor pixel;   ///< [n] int64, row-major; 0 outside
  torch::Tensor depth;   ///< [n] along the optical axis [m]
  torch::Tensor inside;  ///< [n] bool
};
/// Points [n,3] float32 in the frame of the map, on any device.
Projection project(const gaussians::View& view, const torch::Tensor& points);

}  // namespace apvi::survey
