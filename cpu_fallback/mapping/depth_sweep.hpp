// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "apvi/mapping/depth_backend.hpp"

namespace apvi::mapping::cpu {

/// Pyramids of the pictures, kSweepLevels tensors [H,W] int32 a picture as `Level` wants them,
/// empty where a picture would be too small.
SweepPictures make_pyramids(const std::vector<torch::Tensor>& greys);
SweepOutput sweep(const SweepPictures& pictures, const SweepInput& input);
torch::Tensor propagate(const BeliefInput& input);
Surfaces surfaces(const SurfaceInput& input);
torch::Tensor smooth(const SmoothInput& input);

}  // namespace apvi::mapping::cpu
