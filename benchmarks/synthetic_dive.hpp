// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "core/random.hpp"
#include "geometry/spline.hpp"

namespace apvi::bench {

/// Sample rates of a vehicle's sensors [Hz].
struct Rates {
  double imu = 100.0;
  double dvl = 8.0;
  double pressure = 10.0;
};

/// Sensor samples of a vehicle that moves at about 0.5 m/s, generated on demand so that memory does
/// not grow with the length of the dive. The DVL has four beams and stamps delayed by 0.1 s, like a
/// Water Linked A50.
class SyntheticDive {
 public:
  /// `motion_scale`: amplitude of the rotations; 1: an ROV in rough water.
  SyntheticDive(const Rates& rates, double duration_s, std::uint64_t seed = 1,
                double motion_scale = 1.0);

  const Rig& rig() const { return rig_; }
  Stamp start() const { return spline_.start(); }
  Stamp end() const { return end_; }
  Eigen::Vector3d position_at(Stamp stamp) const;
  /// T_world_body without the depth of the world origin.
  SE3 pose_at(Stamp stamp) const { return spline_.at(stamp).T_world_body; }
  /// The samples of the next `length`, in order of time; empty at the end.
  std::vector<SensorEvent> next(Duration length);

 private:
  ImuSample imu_at(Stamp stamp);
  DvlSample dvl_at(Stamp stamp);
  PressureSample pressure_at(Stamp stamp);

  Rates rates_;
  Rig rig_;
  Random random_;
  Se3Spline spline_;
  Stamp end_;
  Stamp next_imu_;
  Stamp next_dvl_;
  Stamp next_pressure_;
};

/// Current resident set size of this process [MiB].
double resident_mib();

}  // namespace apvi::bench
