// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "gaussians/model/gaussians.hpp"

namespace apvi::gaussians {

/// One Gaussian for each group of Gaussians, which looks like them from afar.
///
/// Mean, covariance and color are the moments of the group, weighted by opacity times area, where
/// the area of a Gaussian is that of its largest cross-section. Optical depths, -log(1 - opacity),
/// times areas add up, so that the merged one absorbs as much light as they do. (The moments are
/// those of Kerbl et al., "A hierarchical 3D Gaussian representation for real-time rendering of
/// very large datasets", 2024.)
///
/// `group` [N] int64 on the device of the Gaussians: 0 to `count` - 1, each at least once. All
/// values but opacities must be finite. Gradients are not recorded.
Gaussians merged(const Gaussians& gaussians, const torch::Tensor& group, std::int64_t count);

}  // namespace apvi::gaussians
