// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "apvi/sensors/samples.hpp"

namespace apvi::runs {

/// Magnitudes of the samples of a run: evidence of wrong units. Four bytes per value are kept.
class SampleStatistics {
 public:
  void add(const SensorEvent& event);

  /// Empty without a sample.
  std::optional<double> median_accel() const;      ///< specific force [m/s²]
  std::optional<double> median_gyro() const;       ///< angular rate [rad/s]
  std::optional<double> median_dvl_speed() const;  ///< of pings with bottom lock [m/s]
  /// The speed that 99 % of the pings with bottom lock do not exceed: without outliers [m/s].
  std::optional<double> high_dvl_speed() const;

 private:
  std::vector<float> accel_;
  std::vector<float> gyro_;
  std::vector<float> dvl_speed_;
};

}  // namespace apvi::runs
