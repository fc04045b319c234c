// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "gaussians/render/view.hpp"
#include "runs/survey_run.hpp"
#include "survey/color_rule.hpp"
#include "survey/georeference.hpp"
#include "survey/survey_map.hpp"

namespace apvi::runs {

/// A finished map with its place and its cameras; a map file has none.
struct SurveySource {
  survey::SurveyMap map;
  survey::Georeference reference;
  Trajectory cameras;                  ///< T_crs_camera of the keyframes
  std::vector<gaussians::View> views;  ///< the same, in the frame of the map
};
/// Throws InputError when the source is neither a run with a map nor a map file.
SurveySource load_survey(const SurveyRequest& request);

/// Up to 16 of the cameras, evenly spread.
std::vector<gaussians::View> sample_views(const SurveySource& source);

/// Ground sampling distance of the run's images [m]: the median of depth / focal length over the
/// median pixels of up to 16 keyframes. Throws InputError without keyframes that see a surface.
double ground_sampling_distance(const SurveySource& source);

/// Colors as `apvi render --restore` shows them: exposure and white balance of the keyframes. For a
/// map without keyframes or with a lamp, whose surfaces have another brightness by daylight, those
/// of the map from above. `restore` false: attenuated as at the median depth of the keyframes.
survey::ColorRule colors_of(const SurveySource& source, const survey::SurveyMap& visible,
                            bool restore);

}  // namespace apvi::runs
