// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "apvi/sensors/samples.hpp"
#include "io/rosbag/ros_message.hpp"
#include "io/rosbag/ros_samples.hpp"

/// DVL messages are read by the meaning of their fields: those of Water Linked (dvl_msgs,
/// waterlinked_a50_ros_driver), marine_acoustic_msgs and ds_sensor_msgs, Nortek's Nucleus
/// (BottomTrack), UUV Simulator, Stonefish, and twists.
namespace apvi::io {

/// What the velocity of a DVL message refers to.
struct DvlMeaning {
  bool water_track = false;  ///< relative to the water, not to the bottom
  std::string frame;  ///< coordinates other than the sensor's: "beam", "earth", …; else empty
};

DvlMeaning meaning_of(const RosValue& message);
/// Invalid when the message says so, and when its velocity is not over ground in the sensor frame.
/// nullopt when the message has no velocity.
std::optional<SensorEvent> dvl_of(const RosValue& message, Stamp stamp);
/// The same, with a warning for the first message that is invalid for its meaning.
MessageToEvent dvl_converter(std::string topic);

}  // namespace apvi::io
