// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/samples.hpp"
#include "io/folder/imu_unit.hpp"
#include "io/folder/pressure_unit.hpp"
#include "io/rosbag/ros_message.hpp"

namespace apvi::io {

/// The stamp in a message's header, or its `system_timestamp`; `recorded` when it is absent or
/// zero. nullopt when out of range.
std::optional<Stamp> stamp_of_message(const RosValue& message, Stamp recorded);

/// Converts a message to a sample; nullopt when it is malformed.
using MessageToEvent = std::function<std::optional<SensorEvent>(const RosValue&, Stamp)>;

std::optional<SensorEvent> imu_of(const RosValue& message, Stamp stamp);
/// The same, in these units.
MessageToEvent imu_with(ImuFactors factors);
/// An odometry or pose whose z is minus the depth.
std::optional<SensorEvent> depth_of(const RosValue& message, Stamp stamp);
MessageToEvent pressure_of(const PressureScale& scale);
/// sensor_msgs/Image and CompressedImage. The bytes are copied, and decoded on demand.
MessageToEvent image_of(int camera, std::string topic);
/// Why a message of a sensor was malformed: the kind of problem, and what the message says of
/// itself.
std::pair<std::string, std::string> problem_of(const RosValue& message);
/// The pose of an odometry, pose or transform message; nullopt when it is not finite or the
/// quaternion is far from unit norm.
std::optional<SE3> pose_of(const RosValue& message);

}  // namespace apvi::io
