// SPDX-License-Identifier: BSD-3-Clause
#include "localization/odometry_drift.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dipo/segment.hpp"

namespace apvi::localization {
namespace {

using loop_closure::DriftVariance;

constexpr double kMaxGap_s = 1.0;  // between poses that relate to each other

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

// Of what nothing has measured: dead reckoning would have given a pose.
DriftVariance unknown_motion(const fusion::PoseEstimate& pose, double duration_s) {
  const dipo::SegmentError error(pose.T_world_body, dipo::SegmentError::Matrix6::Zero(), duration_s,
                                 true);
  return variance_of({pose.T_world_body, error.covariance(pose.T_world_body)});
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
  fusion::PoseEstimate pose = *output.fusion.pose;
  pose.covariance -= output.segment_covariance;
  if (last_) {
    const double duration_s = seconds_between(stamp_, output.stamp);
    if (output.begins_segment) {
      since_ += variance_of({pose.T_world_body, output.segment_covariance});
    } else if (is_by_vio(output)) {
      since_ += drift_of_vio(output.vio, duration_s);
      gap_s_ = std::max(gap_s_, duration_s);
    } else {
      since_ += change(*last_, pose);
    }
  }
  last_ = pose;
  if (!at_take_) at_take_ = last_;
  stamp_ = output.stamp;
}

DriftVariance OdometryDrift::take(bool vio_continues) {
  DriftVariance drift = std::exchange(since_, {});
  if (!vio_continues && at_take_) {
    drift = larger(drift, change(*at_take_, *last_));
    if (gap_s_ > kMaxGap_s) drift = larger(drift, unknown_motion(*last_, gap_s_));
  }
  at_take_ = last_;
  gap_s_ = 0.0;
  return drift;
}

double OdometryDrift::height_sigma_m() const {
  return last_ ? std::sqrt(std::max(0.0, variance_of(*last_).vertical)) : 0.0;
}

}  // namespace apvi::localization
