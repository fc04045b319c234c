// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// Robust average of the unit normals [p,3] within `radius_m` of each point [p,3]: an M-estimate
/// with Geman-McClure weights, initialized with the mean, which tolerates outliers from wrong
/// depth. All float64; uses O(p^2) memory. Where normals cancel, the result is arbitrary or zero.
torch::Tensor robust_normals(const torch::Tensor& points, const torch::Tensor& normals,
                             double radius_m);

}  // namespace apvi::mapping
