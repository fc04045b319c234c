// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Whether a file is a sensor.yaml.
bool is_sensor_yaml(const config::Node& file);

/// The section of a sensor, by folder name ("imu0", "cam0", …), as in rig.yaml. `T_BS` stays in it,
/// because EuRoC's body frame need not be that of the IMU; `convert_euroc_poses` replaces it. Keys
/// without a counterpart are ignored. Throws InputError for values that are not understood.
config::Node section_of_sensor_yaml(const std::string& name, const config::Node& sensor);

/// A rig with the section of a single sensor.yaml. Its name is that of the file's folder, else
/// that of `sensor_type` with number 0.
config::Node rig_of_sensor_yaml(const config::Node& file);

/// Replaces `T_BS` by `T_body_sensor`, with imu0 as the body. Without a `T_BS` of imu0, EuRoC's
/// body frame is taken as that of the IMU; true if a pose depends on that.
bool convert_euroc_poses(config::Node& rig);

}  // namespace apvi::io
