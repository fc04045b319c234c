// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"

namespace apvi::runs {

/// A known length between what two pixels of an image show.
struct ScaleBar {
  Stamp image;           ///< as in the names of the files in renders/
  Eigen::Vector2d from;  ///< [px] of the undistorted image; center of the first pixel at 0.5
  Eigen::Vector2d to;
  double length_m = 0.0;
};

/// A known distance of two points in the coordinates of the run's poses.
struct KnownDistance {
  Eigen::Vector3d from;
  Eigen::Vector3d to;
  double length_m = 0.0;
};

struct ScaleRequest {
  std::filesystem::path run;  ///< with a map
  std::filesystem::path folder;
  bool overwrite = false;
  std::vector<ScaleBar> bars{};
  std::vector<KnownDistance> distances{};
  std::optional<double> factor{};  ///< meters per unit of the run, instead of lengths
};

struct ScaleResult {
  double meters_per_unit = 1.0;
  std::vector<double> of_each;  ///< of every bar, then of every distance
};

/// Changes the unit of a run to meters by known lengths: least squares over them, with errors that
/// do not depend on the length. The scaled map, poses and places go to a new run folder; the images
/// of the map stay the same. Throws InputError for a run without a map, and for a length that the
/// map does not show.
ScaleResult scale_run(const ScaleRequest& request);

}  // namespace apvi::runs
