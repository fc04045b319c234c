// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include "importer/vehicle/sensor_data.hpp"

/// What the logs of ArduPilot have in common.
namespace apvi::importer {

/// Parameters of an autopilot, of which some describe the sensors.
class VehicleParameters {
 public:
  void set(const std::string& name, double value) { values_[name] = value; }
  /// Notes the DVL's position (VISO_POS_*), the density of the water (BARO_SPEC_GRAV) and the
  /// surface pressure of the barometer with this number, from 0 on (BARO2_GND_PRESS of number 1).
  void apply(int barometer, SensorData& data) const;

 private:
  std::optional<double> find(const std::string& name) const;

  std::map<std::string, double> values_;
};

/// The velocity of a motion in the body's axes within `duration_s`; invalid without confidence [%].
/// nullopt when the numbers are none.
std::optional<DvlSample> dvl_of_delta(Stamp stamp, const Eigen::Vector3d& motion, double duration_s,
                                      double confidence);

/// Warns that the only barometer of the log `name` is the one inside the autopilot's housing.
void warn_of_internal_pressure(const std::string& name);

}  // namespace apvi::importer
