// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/fusion/config.hpp"
#include "apvi/fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// Leads the output to a target that may jump. Between frames the output moves as the vehicle did;
/// what remains to the target enters bit by bit.
class Slew {
 public:
  explicit Slew(const SlewConfig& config) : config_(config) {}

  /// `motion`: body now in the body of the frame before, by the odometry in charge; nothing: not
  /// known, the target is taken at once. The covariance that comes back includes what remains.
  PoseEstimate follow(double dt, const std::optional<SE3>& motion, const PoseEstimate& target);

  /// What still separated output and target in the newest frame.
  const Vector6& remaining() const { return remaining_; }

 private:
  double step(double size, double dt, double min_rate) const;

  SlewConfig config_;
  std::optional<SE3> output_;
  Vector6 remaining_ = Vector6::Zero();
};

}  // namespace apvi::fusion
