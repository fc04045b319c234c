// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// How the surface around each point [p,3] faces: of the unit normals [p,3] within `radius_m` of
/// it that which most of them are close to (an M-estimate with Geman and McClure's weights, from
/// the mean on). Depth that is wrong in one view leaves a few normals anywhere, which a mean
/// follows. All float64; p squared numbers are held. Where normals cancel, any of unit length or
/// zero.
torch::Tensor prevailing_normals(const torch::Tensor& points, const torch::Tensor& normals,
                                 double radius_m);

}  // namespace apvi::mapping
