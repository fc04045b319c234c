// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "depth/depth_backend.hpp"

namespace apvi::depth::cpu {

/// Image pyramids, kSweepLevels tensors [H,W] int32 per image in the format of `Level`, empty where
/// the image would be too small.
SweepImages make_pyramids(const std::vector<torch::Tensor>& grays);
SweepOutput sweep(const SweepImages& images, const SweepInput& input);
torch::Tensor propagate(const BeliefPropagationInput& input);
FittedPlanes fit_planes(const PlaneFitInput& input);
torch::Tensor smooth(const SmoothInput& input);

}  // namespace apvi::depth::cpu
