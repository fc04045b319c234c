// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "eval/metrics_file.hpp"
#include "localization/smoother.hpp"

namespace apvi::runs {

inline constexpr const char* kSmoothedFile = "trajectory_smoothed.tum";

/// Section `smoothed` of metrics.json: the metrics of the smoothed trajectory, the number of loop
/// closures and of those rejected, the breaks of the path and those after which it was found again,
/// the largest correction of a pose of the odometry, and the time per keyframe.
eval::Json smoothed_json(const localization::Smoother& smoother, const Trajectory& odometry,
                         const Trajectory& smoothed, const eval::TrajectoryMetrics& metrics);

/// Warns if the path was broken and not found again.
void warn_about_breaks(const localization::Smoother& smoother, std::vector<std::string>& warnings);

}  // namespace apvi::runs
