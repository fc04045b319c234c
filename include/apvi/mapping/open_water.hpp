// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <utility>

namespace apvi::mapping {

/// Where a picture [H,W,3] shows nothing but water, which would look like `water` [H,W,3] there
/// (splat::MediumView::open_water): bool [H,W]. Even over a square of several pixels and of nearly
/// that colour; a surface so far off that it has the water's colour counts as water.
///
/// Gaussians of the water's colour would look right there from everywhere, at any distance, and be
/// left when the water is taken away. So none are made there, and those that reach in are let go.
torch::Tensor open_water(const torch::Tensor& picture, const torch::Tensor& water);

/// The mean colour [3,H,W] of a square around each pixel of a picture [H,W,3], and whether it is
/// even [H,W] bool, but for noise.
std::pair<torch::Tensor, torch::Tensor> evenness(const torch::Tensor& picture);

}  // namespace apvi::mapping
