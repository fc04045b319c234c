// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// A number of a pressure sensor, in an unknown unit.
struct PressureReading {
  Stamp stamp;
  double value = 0.0;
};

/// Changes of a vehicle's depth from the velocity of its DVL and the direction of gravity in its
/// accelerations, whose unit does not matter.
class VerticalMotion {
 public:
  explicit VerticalMotion(DvlCalibration dvl) : dvl_(std::move(dvl)) {}

  /// In order of time for each sensor; the sensors may follow one another.
  void add(const ImuSample& sample);
  void add(const DvlSample& ping);

  /// By how much readings grow with each meter of depth, from all spans of some seconds. nullopt
  /// when the vehicle hardly moved vertically, or the readings do not follow its motion.
  std::optional<double> growth_per_meter(const std::vector<PressureReading>& readings) const;

 private:
  struct Force {
    Stamp start;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  };
  struct Velocity {
    Stamp stamp;
    Eigen::Vector3d body = Eigen::Vector3d::Zero();  // [m/s]
  };
  struct Depth {
    Stamp stamp;
    double depth_m = 0.0;  // from any origin
    int span = 0;          // of pings without a gap
  };

  std::optional<Eigen::Vector3d> up_at(Stamp stamp) const;
  std::vector<Depth> integrate() const;

  DvlCalibration dvl_;
  std::vector<Force> forces_;
  std::vector<Velocity> velocities_;
};

/// Reads what is needed of a recording when it is needed; nullopt where it cannot be.
using MotionReader = std::function<std::optional<VerticalMotion>()>;

/// The DVL that the rig describes; nullopt when it describes none, or not correctly.
std::optional<DvlCalibration> dvl_of_rig(const config::Node& rig);

}  // namespace apvi::io
