// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "map_io/origin.hpp"
#include "runs/run_config.hpp"
#include "runs/survey/survey_run.hpp"
#include "survey/color_rule.hpp"
#include "survey/georeference.hpp"
#include "survey/survey_map.hpp"
#include "survey/survey_view.hpp"

namespace apvi::runs {

/// A finished map with its place and its cameras; a map file has none.
struct SurveySource {
  survey::SurveyMap map;
  survey::Georeference reference;
  Trajectory cameras;                     ///< T_crs_camera of the keyframes
  std::vector<survey::SurveyView> views;  ///< the same, in the frame of the map
  Trajectory bodies;                      ///< the same of the body, in the recording's world
  map_io::Origin origin{};                ///< of the map, in the recording's world
  std::optional<RunConfig> config;        ///< of the run
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
