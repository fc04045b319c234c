// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/samples.hpp"
#include "io/ros_message.hpp"

namespace apvi::io {

/// The time in a message's header; `recorded` when it has none or says zero. Nothing when it is out
/// of range.
std::optional<Stamp> stamp_of_message(const RosValue& message, Stamp recorded);

/// Makes a sample of a message, or nothing when it is malformed.
using MessageToEvent = std::function<std::optional<SensorEvent>(const RosValue&, Stamp)>;

std::optional<SensorEvent> imu_of(const RosValue& message, Stamp stamp);
/// Water Linked, UUV Simulator and others with a `velocity`; twists; odometry's twist.
std::optional<SensorEvent> dvl_of(const RosValue& message, Stamp stamp);
/// An odometry or pose whose z is minus the depth.
std::optional<SensorEvent> depth_of(const RosValue& message, Stamp stamp);
MessageToEvent pressure_of(PressureUnit unit, std::string topic);
/// sensor_msgs/Image and CompressedImage. The bytes are copied, and decoded when asked for.
MessageToEvent image_of(int camera, std::string topic);
/// The pose in an odometry, pose or transform message; nothing when it is not finite or the
/// quaternion is far from unit norm.
std::optional<SE3> pose_of(const RosValue& message);

}  // namespace apvi::io
