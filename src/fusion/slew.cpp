// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/slew.hpp"

#include <algorithm>
#include <cmath>

namespace apvi::fusion {

// The part of a distance to the target that is covered in `dt`.
double Slew::step(double size, double dt, double min_rate) const {
  if (config_.time_constant_s == 0.0) return size;
  const double fraction = 1.0 - std::exp(-dt / config_.time_constant_s);
  return std::min(size, std::max(size * fraction, min_rate * dt));
}

PoseEstimate Slew::update(double dt, const std::optional<SE3>& motion, const PoseEstimate& target) {
  if (!output_ || !motion) {
    output_ = target.T_world_body;
    return target;
  }
  const SE3 predicted = *output_ * *motion;
  Vector6 correction = boxminus(target.T_world_body, predicted);
  const double turn = correction.head<3>().norm();
  const double distance = correction.tail<3>().norm();
  if (turn > 0.0) {
    correction.head<3>() *= step(turn, dt, config_.min_rate_deg_s * kRadiansPerDegree) / turn;
  }
  if (distance > 0.0) correction.tail<3>() *= step(distance, dt, config_.min_speed_m_s) / distance;
  output_ = boxplus(predicted, correction);
  const Vector6 remaining = boxminus(target.T_world_body, *output_);
  return {*output_, target.covariance + remaining * remaining.transpose()};
}

}  // namespace apvi::fusion
