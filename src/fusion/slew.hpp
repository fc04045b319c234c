// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/fusion/config.hpp"
#include "fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// Slew-rate limiter for an output whose target may jump. Between frames the output follows the
/// motion of the vehicle; the remaining difference to the target enters gradually.
class Slew {
 public:
  explicit Slew(const SlewConfig& config) : config_(config) {}

  /// `motion`: body pose in the previous body frame, from the active odometry; nullopt: unknown,
  /// the output jumps to the target. The returned covariance includes the remaining difference.
  PoseEstimate update(double dt, const std::optional<SE3>& motion, const PoseEstimate& target);

 private:
  double step(double size, double dt, double min_rate) const;

  SlewConfig config_;
  std::optional<SE3> output_;
};

}  // namespace apvi::fusion
