// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "mapping/rendering.hpp"
#include "survey/ground_products.hpp"
#include "survey/survey_view.hpp"

namespace apvi::survey {

/// Which points [n,3] (float64, in the frame of the map) are on a surface that at least three views
/// show, or all if there are fewer: [n] bool on the CPU. A view shows it if its depth
/// (`reliable_depth`) is that of the point within `tolerance_m`. A truncated signed distance
/// function has a surface also where a single view is wrong: other views do not count behind what
/// they see.
torch::Tensor supported_points(const torch::Tensor& points, const mapping::Map& map,
                               const std::vector<SurveyView>& views, double tolerance_m,
                               const Progress& progress);

}  // namespace apvi::survey
