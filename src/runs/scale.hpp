// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "apvi/localization/system.hpp"
#include "apvi/sensors/rig.hpp"
#include "eval/metrics_file.hpp"
#include "localization/active_sensors.hpp"

namespace apvi::runs {

/// Where the meters of a run come from.
enum class ScaleSource {
  dvl,
  stereo,
  pressure,       ///< one camera and its changes of depth
  accelerometer,  ///< one camera and an IMU: uncertain
  images,         ///< one camera alone: unknown
  given_poses,
  unknown,  ///< given poses of a reconstruction whose unit nobody knows
};

ScaleSource scale_of(const Rig& rig, const localization::ActiveSensors& sensors);
ScaleSource source_of(localization::ScaleSensor sensor);
bool is_known(ScaleSource source);
/// Of a map with given poses: unknown if they are the recording's and its import.yaml says so.
/// `poses_file` replaces the recording's poses; may be empty.
ScaleSource scale_of_given_poses(const std::filesystem::path& recording,
                                 const std::filesystem::path& poses_file);

/// Section `scale` of metrics.json: `source`, and whether distances are in meters (`known`).
eval::Json scale_json(ScaleSource source);
/// Warns when distances are uncertain or not in meters.
void warn_about_scale(ScaleSource source);

}  // namespace apvi::runs
