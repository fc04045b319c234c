// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Compares how gravity turns in the accelerations with what the angular rates say, over steps of a
/// tenth of a second. The scale of the accelerations does not matter.
class GravityTurn {
 public:
  void add(const ImuSample& sample);
  /// Rate of the turn in the accelerations as a fraction of that by the gyro: near 1 for rad/s and
  /// 0.017 for deg/s. 0 without data; of no meaning when the vehicle turns about the vertical only.
  double ratio() const { return predicted_ > 0.0 ? common_ / predicted_ : 0.0; }

 private:
  /// Sums of the samples of a step.
  struct Step {
    Stamp start;
    double count = 0.0;
    Eigen::Vector3d rate = Eigen::Vector3d::Zero();
    Eigen::Vector3d force = Eigen::Vector3d::Zero();
  };

  void finish_step();

  Step step_;
  std::optional<Step> before_;  // means
  double common_ = 0.0;         // sum of the products of both turns
  double predicted_ = 0.0;      // sum of the squares of the turn by the gyro
};

}  // namespace apvi::io
