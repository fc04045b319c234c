// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "gaussians/render/view.hpp"
#include "survey/survey_map.hpp"

namespace apvi::survey {

/// The Gaussians that products from above show. Of up to 2048 views, evenly spread, at least three
/// (or all, if there are fewer) have the center in their image, and the nearest of them is not
/// farther than twice the median of these distances: other Gaussians are background. They are not
/// higher than the camera that is horizontally nearest: no camera saw such ones from above.
/// Occlusion is not considered. Without views nothing is removed.
SurveyMap seen_from_above(const SurveyMap& map, const std::vector<gaussians::View>& views);

}  // namespace apvi::survey
