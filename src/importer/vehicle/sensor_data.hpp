// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/sensors/samples.hpp"
#include "io/rosbag/navsat.hpp"

namespace apvi::importer {

struct GnssFix {
  Stamp stamp;
  io::GeodeticPosition position;
};

/// What files beside the images tell of a vehicle: samples in SI units and in order of time, on one
/// clock: Unix time, or time since the vehicle was switched on.
struct SensorData {
  std::vector<ImuSample> imu;
  std::vector<DvlSample> dvl;
  std::vector<PressureSample> pressure;
  std::vector<PressureDepthSample> depth;
  std::vector<GnssFix> gnss;

  /// The IMU's axes are known to be forward, right, down, as those of an autopilot.
  bool is_forward_right_down = false;
  std::optional<Eigen::Vector3d> p_body_dvl = {};  ///< as the autopilot has it [m]
  std::optional<double> water_density = {};        ///< [kg/m³]
  std::optional<double> surface_pressure_pa = {};

  /// "12345 of the IMU, 678 of the DVL"; empty without samples.
  std::string summary() const;
  bool empty() const { return !span(); }
  /// First and last stamp; nullopt without samples.
  std::optional<std::pair<Stamp, Stamp>> span() const;
  /// Sorts the samples by their stamps; of those with equal stamps the first remains.
  void put_in_order();
  /// Keeps the samples in [from, to].
  void restrict_to(Stamp from, Stamp to);
  /// Takes over all kinds of samples that `other` has, in place of those that are here.
  void take(SensorData other);
};

/// Mean rate of samples in order of time [Hz]; 1 for a single one.
template <typename Sample>
double rate_hz(const std::vector<Sample>& samples) {
  if (samples.size() < 2) return 1.0;
  const double span = seconds_between(samples.front().stamp, samples.back().stamp);
  return static_cast<double>(samples.size() - 1) / span;
}

}  // namespace apvi::importer
