// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "apvi/sensors/rig.hpp"
#include "importer/vehicle/sensor_data.hpp"

/// Rigs of sensors that nobody has calibrated: each is assumed to be at the IMU, with usual axes.
namespace apvi::importer {

/// Axes of the body frame, which is the IMU's, or, without an IMU, the camera's (x right, y down,
/// z forward).
enum class BodyAxes { forward_right_down, forward_left_up, camera };

/// The axes that the IMU's mean specific force shows, or that an autopilot has; a warning says when
/// it shows none. Without an IMU: the camera's if there are images, else forward, right, down.
BodyAxes body_axes(const SensorData& data, bool has_images);
/// The axes that go with the world of a given rig.
BodyAxes body_axes(const Rig& rig);

/// T_body_sensor of a camera that looks forward with the top of the image up, as in rig.yaml.
std::string camera_pose(BodyAxes axes);

/// The sections of rig.yaml for sensors with data that `given` does not describe, and its `world`.
std::string sensor_yaml(const SensorData& data, BodyAxes axes, const std::optional<Rig>& given);

}  // namespace apvi::importer
