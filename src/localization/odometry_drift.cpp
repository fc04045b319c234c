// SPDX-License-Identifier: BSD-3-Clause
#include "localization/odometry_drift.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace apvi::localization {
namespace {

using loop_closure::DriftVariance;

DriftVariance variance_of(const fusion::PoseEstimate& pose) {
  const Eigen::Vector3d position = pose.covariance.diagonal().tail<3>();
  return {.heading = fusion::world_rotation_covariance(pose)(2, 2),
          .horizontal = 0.5 * (position.x() + position.y()),
          .vertical = position.z()};
}

DriftVariance change(const fusion::PoseEstimate& before, const fusion::PoseEstimate& after) {
  const DriftVariance a = variance_of(before);
  const DriftVariance b = variance_of(after);
  return {std::abs(b.heading - a.heading), std::abs(b.horizontal - a.horizontal),
          std::abs(b.vertical - a.vertical)};
}

bool is_by_vio(const FrameOutput& output) {
  const fusion::FusionState state = output.fusion.state;
  return (state == fusion::FusionState::fused || state == fusion::FusionState::vio_only) &&
         output.vio.has_state() && output.vio.window_s > 0.0;
}

// Of the motion over the window.
DriftVariance drift_of_vio(const vio::Result& vio, double duration_s) {
  const fusion::PoseEstimate motion{vio.state.pose(),
                                    fusion::covariance_of(vio.window_information)};
  return variance_of(motion) * (duration_s / vio.window_s);
}

DriftVariance larger(const DriftVariance& a, const DriftVariance& b) {
  return {std::max(a.heading, b.heading), std::max(a.horizontal, b.horizontal),
          std::max(a.vertical, b.vertical)};
}

}  // namespace

void OdometryDrift::add(const FrameOutput& output) {
  if (!output.fusion.pose) return;
  if (last_) {
    const double duration_s = seconds_between(stamp_, output.stamp);
    since_ += is_by_vio(output) ? drift_of_vio(output.vio, duration_s)
                                : change(*last_, *output.fusion.pose);
  }
  last_ = output.fusion.pose;
  if (!at_take_) at_take_ = last_;
  stamp_ = output.stamp;
}

DriftVariance OdometryDrift::take(bool vio_continues) {
  DriftVariance drift = std::exchange(since_, {});
  if (!vio_continues && at_take_) drift = larger(drift, change(*at_take_, *last_));
  at_take_ = last_;
  return drift;
}

double OdometryDrift::height_sigma_m() const {
  return last_ ? std::sqrt(std::max(0.0, variance_of(*last_).vertical)) : 0.0;
}

}  // namespace apvi::localization
