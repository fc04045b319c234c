// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "apvi/dipo/dipo.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/vio/estimator.hpp"
#include "apvi/vio/observation.hpp"

namespace apvi::pipeline {

/// What the DVL's beams met, as seen from the body at that time.
struct RangedPing {
  Stamp stamp;                          ///< on the inertial clock
  std::vector<Eigen::Vector3d> points;  ///< body frame [m]
};

/// A camera frame with all that the other sensors have to say about it: what goes from stage to
/// stage. Everything that a later stage may know is in it, so that stages on threads of their own
/// give the same result as one after the other.
struct FrameJob {
  Stamp stamp;                     ///< on the inertial clock
  std::vector<ImageFrame> images;  ///< by camera; one without `decode` was lost
  std::vector<ImuSample> imu;      ///< since the job before, up to the first at or after the stamp
  std::vector<vio::DvlMeasurement> pings;  ///< since the job before
  std::vector<RangedPing> ranges;          ///< the same pings
  std::vector<vio::DepthMeasurement> depths;
  std::optional<vio::Aid> dipo;                    ///< the acoustic odometry at the stamp
  std::vector<dipo::Report> reports;               ///< of pings since the job before
  std::optional<Eigen::Quaterniond> R_before_now;  ///< body rotation since the job before
};

}  // namespace apvi::pipeline
