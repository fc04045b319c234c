// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "apvi/sensors/samples.hpp"
#include "dipo/dipo.hpp"
#include "vio/estimator.hpp"
#include "vio/window/observation.hpp"

namespace apvi::localization {

/// End points of the DVL's beams at a ping.
struct RangePoints {
  Stamp stamp;                          ///< on the IMU clock
  std::vector<Eigen::Vector3d> points;  ///< body frame [m]
};

/// A camera frame with the data of all other sensors since the previous one, passed from stage to
/// stage. It holds everything that later stages use, so that running the stages on separate threads
/// gives the same result as running them in sequence.
struct FrameJob {
  Stamp stamp;                     ///< on the IMU clock
  std::vector<ImageFrame> images;  ///< by camera; without `decode` if lost
  std::vector<ImuSample> imu;  ///< since the previous job, up to the first at or after the stamp
  std::vector<vio::DvlMeasurement> pings;  ///< since the previous job
  std::vector<RangePoints> range_points;   ///< of the same pings
  std::vector<vio::PressureDepthMeasurement> depths;
  std::optional<vio::StatePrior> dipo;             ///< acoustic odometry at the stamp
  std::vector<dipo::Report> reports;               ///< of pings since the previous job
  std::optional<Eigen::Quaterniond> R_before_now;  ///< body rotation since the previous job
};

}  // namespace apvi::localization
