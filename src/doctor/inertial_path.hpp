// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::doctor {

/// What the inertial sensor alone says, summed up from the first sample. The frame "start" is the
/// body's at the first sample, carried on by the gyro; gravity is not taken out, so it drifts as
/// the gyro does and serves for differences over seconds.
struct InertialState {
  Eigen::Quaterniond R_start_body = Eigen::Quaterniond::Identity();
  Eigen::Vector3d force_integral = Eigen::Vector3d::Zero();     ///< of R f dt [m/s]
  Eigen::Matrix3d rotation_integral = Eigen::Matrix3d::Zero();  ///< of R dt [s]
  Eigen::Vector3d up_body = Eigen::Vector3d::UnitZ();  ///< against gravity, complementary filter
};

class InertialPath {
 public:
  /// `samples` in order of time. Estimates the gyro's bias from how gravity appears to turn (what
  /// lies along gravity it cannot see).
  explicit InertialPath(const std::vector<ImuSample>& samples);

  bool empty() const { return nodes_.size() < 2; }
  Stamp start() const { return empty() ? Stamp{} : nodes_.front().stamp; }
  Stamp end() const { return empty() ? Stamp{} : nodes_.back().stamp; }
  /// Seconds from the start.
  double seconds(Stamp stamp) const { return seconds_between(start(), stamp); }
  /// Nothing outside the span or inside a gap of the IMU.
  std::optional<InertialState> at(double t) const;
  /// Angular velocity of the body, mean over 60 ms [rad/s].
  std::optional<Eigen::Vector3d> rate_at(double t) const;
  /// Whether the IMU has no gap between two times.
  bool unbroken(double from, double to) const;
  const Eigen::Vector3d& gyro_bias() const { return gyro_bias_; }

 private:
  struct Node {
    Stamp stamp;
    double t = 0.0;
    int gaps_before = 0;
    InertialState state;
  };
  std::size_t index_before(double t) const;

  std::vector<Node> nodes_;
  Eigen::Vector3d gyro_bias_ = Eigen::Vector3d::Zero();
};

}  // namespace apvi::doctor
