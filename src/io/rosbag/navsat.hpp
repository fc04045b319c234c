// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "io/rosbag/ros_message.hpp"

namespace apvi::io {

/// A position on the WGS84 ellipsoid.
struct GeodeticPosition {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double altitude_m = 0.0;  ///< above the ellipsoid; NaN if unknown
};

/// The position of a sensor_msgs/NavSatFix; nullopt without a fix: a negative status, values that
/// are not finite, or zero latitude and longitude, which receivers report before their first fix.
std::optional<GeodeticPosition> fix_of(const RosValue& message);
/// False for zero latitude and longitude, which receivers report before their first fix, and for
/// what is not finite or no angle.
bool is_fix(const GeodeticPosition& position);

/// Position in the tangent plane at `origin`: east, north, up [m]. An unknown altitude is that of
/// the origin, or zero.
Eigen::Vector3d east_north_up(const GeodeticPosition& position, const GeodeticPosition& origin);

}  // namespace apvi::io
