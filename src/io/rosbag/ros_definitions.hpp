// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace apvi::io {

/// Message type of a bag connection.
struct RosDefinition {
  std::string type;
  std::string md5;
  std::string text;  ///< with the nested definitions after separators, as rosbag stores it
};

const RosDefinition& imu_definition();
const RosDefinition& fluid_pressure_definition();
const RosDefinition& odometry_definition();
const RosDefinition& compressed_image_definition();
/// waterlinked_a50_ros_driver/DVL.
const RosDefinition& waterlinked_dvl_definition();

}  // namespace apvi::io
