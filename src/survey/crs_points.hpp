// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <Eigen/Core>

#include "survey/survey_map.hpp"

namespace apvi::survey {

/// Rotation of `map.T_crs_map` [3,3] float64, on the device of the map.
torch::Tensor crs_rotation(const SurveyMap& map);
/// Centers of the Gaussians in the coordinate reference system, minus `anchor` [m]: [N,3] float64.
/// Differences to a near anchor keep the precision that UTM coordinates in float32 would lose.
torch::Tensor crs_points(const SurveyMap& map, const Eigen::Vector3d& anchor);

}  // namespace apvi::survey
