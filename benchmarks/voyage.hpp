// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/core/random.hpp"
#include "apvi/geometry/spline.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::bench {

/// Sample rates of a vehicle's sensors [Hz].
struct Rates {
  double imu = 100.0;
  double dvl = 8.0;
  double pressure = 10.0;
};

/// Samples of a vehicle that swims about at half a metre per second, made as they are asked for so
/// that a long voyage takes no memory. The DVL has four beams and its stamps are 0.1 s late, as an
/// A50's are.
class Voyage {
 public:
  /// `unrest`: how wildly it turns, 1 like a ROV that is thrown about.
  Voyage(const Rates& rates, double duration_s, std::uint64_t seed = 1, double unrest = 1.0);

  const Rig& rig() const { return rig_; }
  Stamp start() const { return spline_.start(); }
  Stamp end() const { return end_; }
  Eigen::Vector3d position_at(Stamp stamp) const;
  /// T_world_body without the depth of the world's origin.
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

/// Memory of this process that is in use now [MiB].
double resident_mib();

}  // namespace apvi::bench
