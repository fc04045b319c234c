// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Parses the text of one sensor.yaml as EuRoC publishes it, with or without OpenCV's "%YAML:1.0"
/// first line and matrix tags. Throws InputError with `source` and the line for invalid YAML.
config::Node parse_sensor_yaml(std::string text, const std::string& source);

/// Converts the per-sensor files, by folder name ("imu0", "cam0", …), to the nodes of a rig.yaml.
/// Keys without a counterpart are ignored. Poses, which EuRoC gives in a separate body frame, are
/// transformed to the IMU frame. Throws InputError for matrices that are not 4x4.
config::Node rig_of_sensor_yamls(const std::map<std::string, config::Node>& sensors);

}  // namespace apvi::io
