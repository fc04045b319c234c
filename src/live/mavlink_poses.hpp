// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "io/mavlink/frame.hpp"
#include "live/pose_output.hpp"

/// Poses as an autopilot takes them. The body frame must be MAVLink's: forward, right, down.
namespace apvi::live {

/// ODOMETRY: pose in a local frame forward, right, down (`MAV_FRAME_LOCAL_FRD`), velocity in the
/// body frame, covariance of position and attitude, reset counter. `world_is_up`: the world of the
/// pose has z up and is turned about x.
io::mavlink::Frame mavlink_odometry(const PoseOutput& pose, bool world_is_up);

/// VISION_POSITION_DELTA: the motion between two poses, in the body frame at the first. nullopt
/// when the pose has jumped in between.
std::optional<io::mavlink::Frame> mavlink_position_delta(const PoseOutput& from,
                                                         const PoseOutput& to);

}  // namespace apvi::live
