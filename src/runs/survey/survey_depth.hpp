// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "runs/survey/survey_source.hpp"
#include "survey/ground_products.hpp"

namespace apvi::runs {

/// Compares the images of the recording with each other around the surface that the map shows, and
/// writes into the views of `source` where the depth differs and where the images confirm no
/// surface (depth::refine_depth). Returns false, with a warning, when the images cannot be read;
/// the map's depth counts then. Throws what `progress` throws.
bool compare_survey_images(SurveySource& source, const survey::Progress& progress);

}  // namespace apvi::runs
