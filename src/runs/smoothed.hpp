// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "eval/metrics_file.hpp"
#include "localization/smoother.hpp"

namespace apvi::runs {

inline constexpr const char* kSmoothedFile = "trajectory_smoothed.tum";

/// Section `smoothed` of metrics.json: the metrics of the smoothed trajectory, the number of loop
/// closures and of those rejected, the largest correction of a pose of the odometry, and the time
/// per keyframe.
eval::Json smoothed_json(const localization::Smoother& smoother, const Trajectory& odometry,
                         const Trajectory& smoothed, const eval::TrajectoryMetrics& metrics);

}  // namespace apvi::runs
