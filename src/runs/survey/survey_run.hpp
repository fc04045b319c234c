// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "survey/georeference.hpp"

namespace apvi::runs {

/// A product of a survey: what to make of a map.
struct SurveyRequest {
  std::filesystem::path source;  ///< run folder or map file
  std::string product;           ///< orthomosaic, elevation, las, poses, mesh or survey
  std::filesystem::path out{};   ///< folder
  /// Size of a pixel on the ground or of a voxel [m]. Empty: the ground sampling distance of the
  /// run's images, for pixels rounded up to 1, 2 or 5 times a power of ten, for voxels doubled.
  std::optional<double> resolution_m{};
  survey::GeoreferenceOptions georeference{};
  /// Positions in the coordinate reference system to fit the run's trajectory to, in place of
  /// origin and heading; empty: none. See `fit_georeference`.
  std::filesystem::path positions{};
  bool compare_images = true;       ///< false: surfaces are where the map shows them
  bool restore = true;              ///< false: colors attenuated by the medium
  double contour_interval_m = 0.1;  ///< between contour lines
  std::function<bool()> interrupted = [] { return false; };
};

bool is_survey_product(const std::string& word);

/// Makes a product in `out`, which is created. Throws InputError for invalid input, RunError when
/// something cannot be written or the request is interrupted.
void export_survey(const SurveyRequest& request);

}  // namespace apvi::runs
