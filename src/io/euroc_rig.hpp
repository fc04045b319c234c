// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Parses the text of one sensor.yaml as EuRoC publishes it, with or without OpenCV's "%YAML:1.0"
/// first line and matrix tags. Throws InputError naming `source` and the line when it is no YAML.
config::Node parse_sensor_yaml(std::string text, const std::string& source);

/// The nodes of a rig.yaml made of the sensors' own files, by folder name ("imu0", "cam0", …). Keys
/// that say nothing to the estimator are left out. Poses, which EuRoC gives in a body frame of its
/// own, are turned into the IMU's frame. Throws InputError for matrices that are not 4x4.
config::Node rig_of_sensor_yamls(const std::map<std::string, config::Node>& sensors);

}  // namespace apvi::io
