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

/// Integrals of the IMU data from the first sample. The frame "start" is the body frame at the
/// first sample, propagated by the gyro; gravity is not removed. It drifts with the gyro and is
/// only valid for differences over seconds.
struct InertialState {
  Eigen::Quaterniond R_start_body = Eigen::Quaterniond::Identity();
  Eigen::Vector3d force_integral = Eigen::Vector3d::Zero();     ///< of R f dt [m/s]
  Eigen::Matrix3d rotation_integral = Eigen::Matrix3d::Zero();  ///< of R dt [s]
  Eigen::Vector3d up_body =
      Eigen::Vector3d::UnitZ();  ///< opposite to gravity, from a complementary filter
};

class InertialPath {
 public:
  /// `samples` in order of time. Estimates the gyro bias from the apparent rotation of gravity (the
  /// component along gravity is unobservable).
  explicit InertialPath(const std::vector<ImuSample>& samples);

  bool empty() const { return nodes_.size() < 2; }
  Stamp start() const { return empty() ? Stamp{} : nodes_.front().stamp; }
  Stamp end() const { return empty() ? Stamp{} : nodes_.back().stamp; }
  /// Seconds from the start.
  double seconds(Stamp stamp) const { return seconds_between(start(), stamp); }
  /// Empty outside the time span or inside an IMU gap.
  std::optional<InertialState> at(double t) const;
  /// Mean angular velocity of the body over 60 ms [rad/s].
  std::optional<Eigen::Vector3d> rate_at(double t) const;
  /// Whether the IMU data have no gap between two times.
  bool is_continuous(double from, double to) const;
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
